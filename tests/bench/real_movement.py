"""Bias and orientation on BROAD's real movement, every trial that is there, beside VQF. `make bench-broad`.

One run gives medians over the trials, in their moving phases: bias (°/s rms per axis) as recorded, with no rest first, and
with a ramp of 0.05 °/s a minute; heading drift from the second minute of movement on, in which a matrix may have been
learnt; total orientation error; and NEES per axis. A bias that walks four times as fast as the model says is simulated.
Nothing is told of the sensors unless --model says so: truerate is run as `truerate correct --learn-matrix` runs.
"oracle" is the orientation from the true bias and the matrix fitted to the very trial by optics, and the bias that a filter with
the optical orientation in place of the accelerometer finds in real time: the limits of any bias, matrix and accelerometer.
"""

import argparse
import sys
from collections import defaultdict
from dataclasses import dataclass, replace

import numpy as np
import vqf
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bridge.recording import Recording
from bridge.wire.messages import Quality
from estimator.config.device_settings import knobs_of, learning
from estimator.device.correction import Correction
from estimator.device.session_knobs import SessionKnobs
from estimator.geometry.gyro_model import GyroModel
from estimator.noise.device_model import GENERIC, load_model
from estimator.offline.recordings import correct
from estimator.orientation.attitude import Attitude
from tests.bench import broad
from tests.bench.optical import bias_by_optics, matrix_of
from tests.bench.orientation import errors
from tests.bench.trackers import Floats
from tests.sim.day import simulate_day, worn_spec
from tests.sim.scenes import rests_and_motion

#: s of movement in which a matrix may be learnt before the heading's drift counts
LEARNING_S = 60.0
#: how much faster the simulated bias walks than the model says
HURRY = 4.0
#: rad/s per root second with which the ramp is followed best; rad/s, the bias's prior: what the oracle is told
RAMP_WALK, BIAS_STD = np.radians(3e-3), np.radians(0.5)
METHODS = "VQF", "VQF offline", "truerate", "truerate smoothed", "oracle bias", "oracle"


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table: goals in real time and smoothed; NaN for none."""

    name: str
    unit: str
    goal: float = np.nan
    goal_smoothed: float = np.nan


ROWS = (
    Row("as recorded", "°/s", 0.0032, 0.0018),
    Row("no rest before", "°/s", 0.084, 0.004),
    Row("ramp 0.05 °/s/min", "°/s", 0.033),
    Row("heading drift", "°/min", 1.3, 1.0),
    Row("total orientation", "°", 1.8, 1.3),
    Row("inclination", "°", 0.5, 0.38),
    Row("NEES, as recorded", "", 1.0),
    Row("NEES, no rest before", "", 1.0),
    Row("NEES, walk ×1, rests", "", 1.0),
    Row("NEES, walk ×4, rests", "", 1.0),
    Row("NEES, walk ×1, day", "", 1.0),
    Row("NEES, walk ×4, day", "", 1.0),
)

Results = dict[str, dict[str, dict[str, float]]]


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What a method makes of a recording: bias and its std (n, 3) rad/s, attitudes (n, 4)."""

    bias: Floats
    std: Floats | None
    quat_wxyz: Floats


def run(method: str, trial: broad.Trial, knobs: SessionKnobs) -> Found:
    """One of METHODS on a trial."""
    gyro, accel, step = np.ascontiguousarray(trial.gyro), np.ascontiguousarray(trial.accel), 1 / trial.rate_hz
    if method == "VQF":
        state = vqf.VQF(step).updateBatchFullState(gyro, accel)
        return Found(state["bias"], None, state["quat6D"])
    if method == "VQF offline":
        state = vqf.offlineVQF(gyro, accel, None, step)
        return Found(state["bias"], None, state["quat6D"])
    if method.startswith("oracle"):
        return oracle(trial, matrix_of([trial]) if method == "oracle" else np.eye(3), knobs)
    recording = Recording.from_arrays(gyro, accel, rate_hz=trial.rate_hz)
    c = correct(recording, knobs=knobs, smooth=method.endswith("smoothed"))
    return Found(c.bias.astype(float), c.bias_std.astype(float), c.quat_wxyz.astype(float))


def oracle(trial: broad.Trial, matrix: Floats, knobs: SessionKnobs) -> Found:
    """truerate's orientation from the true bias through a matrix."""
    small = np.full(3, 1e-4)
    model = GyroModel(matrix, np.zeros(3), small, small, np.full(3, 2e-3))
    known = Correction(model, small, Quality.GOOD, "", 0.0).known
    rows = np.full((len(trial.gyro), 9), np.nan)
    rows[:, 0], rows[:, 1:4], rows[:, 4:7] = (
        np.arange(1, len(rows) + 1) / trial.rate_hz,
        trial.gyro - trial.bias,
        trial.accel,
    )
    rows[:, 7] = 0.0
    return Found(trial.bias, None, Attitude().take(rows, known).quat_wxyz)


def judge(found: Found, trial: broad.Trial) -> dict[str, float]:
    """Errors of orientation on a trial as recorded."""
    first = int(np.argmax(trial.moving))
    inclination, heading = errors(found.quat_wxyz, trial.attitude, slice(0, first))
    at = trial.moving & np.isfinite(inclination)
    later = at & (np.arange(len(at)) > first + LEARNING_S * trial.rate_hz)
    minutes = np.flatnonzero(later) / trial.rate_hz / 60
    drift = np.polyfit(minutes, np.degrees(np.unwrap(heading[later])), 1)[0]
    rms = [float(np.degrees(np.sqrt(np.mean(square[at])))) for square in (inclination**2 + heading**2, inclination**2)]
    return {"heading drift": float(abs(drift)), "total orientation": rms[0], "inclination": rms[1]}


def nees(found: Found, bias: Floats, counted: NDArray[np.bool_]) -> float:
    """Mean over samples and axes of squared error by variance."""
    assert found.std is not None
    return float(np.mean(((found.bias - bias) / found.std)[counted] ** 2))


def measured(trials: list[broad.Trial], knobs: SessionKnobs, methods: tuple[str, ...] = METHODS) -> Results:
    """Every row of real movement, by method and trial."""
    results: Results = {row.name: defaultdict(dict) for row in ROWS}
    for trial in trials:
        for name in broad.SCENARIOS[:3]:
            changed = broad.scenario(name, trial)
            for method in methods:
                if method == "oracle" and name != "as recorded":  # where rests tell little
                    walk, std = RAMP_WALK if name.startswith("ramp") else knobs.track.bias.rate_random_walk, BIAS_STD
                    seen = bias_by_optics(changed, matrix_of([trial]), walk, std)
                    results[name][method][trial.name] = changed.rmse_dps(seen)
                if method.startswith("oracle") and name != "as recorded":
                    continue
                found = run(method, changed, knobs)
                worth = {} if method.startswith("oracle") else {name: changed.rmse_dps(found.bias)}
                if name == "as recorded":
                    worth |= judge(found, changed)
                if found.std is not None and f"NEES, {name}" in results:
                    worth[f"NEES, {name}"] = nees(found, changed.bias, changed.moving)
                for row, value in worth.items():
                    results[row][method][trial.name] = value
    return results


def simulated(results: Results, seeds: int) -> None:
    """NEES where the bias walks as the model says, and faster: rests and movement in turn, and wearers' hours."""
    model = load_model("icm-20948")
    knobs = knobs_of(model)
    walk = float(np.degrees(knobs.track.bias.rate_random_walk))
    for times in (1.0, HURRY):
        for seed in range(seeds):
            rests = rests_and_motion(3000 + seed, 900.0, rrw_dps_per_sqrt_s=times * walk)
            spec = replace(worn_spec(52.0), rrw_dps_per_sqrt_s=times * walk)
            days = {"rests": rests, "day": simulate_day(3000 + seed, 0.5, 52.0, spec)}
            for what, day in days.items():
                told = replace(
                    Recording.from_arrays(day.gyro.astype(float), day.accel.astype(float), rate_hz=day.rate_hz),
                    temperature_c=day.temperature_c.astype(float),
                )
                c = correct(told, knobs=knobs)
                found = Found(c.bias.astype(float), c.bias_std.astype(float), c.quat_wxyz.astype(float))
                counted = day.time_s > 60
                row = f"NEES, walk ×{times:g}, {what}"
                results[row]["truerate"][f"seed {seed}"] = nees(found, day.bias.astype(float), counted)


def shown(results: Results) -> Table:
    """Medians (and the worst trial of the bias as recorded)."""
    table = Table(title="medians (worst)", title_justify="left", title_style="bold", box=None, pad_edge=False)
    table.add_column("")
    for heading in (*METHODS, "goal", "smoothed"):
        table.add_column(heading.replace(" ", "\n", 1), justify="right", no_wrap=True)
    for row in ROWS:
        cells = []
        for method in METHODS:
            values = list(results[row.name].get(method, {}).values())
            cells.append(f"{np.median(values):.4f} ({max(values):.3f})" if values else "–")
        goals = ("–" if np.isnan(goal) else f"{goal:g}" for goal in (row.goal, row.goal_smoothed))
        table.add_row(f"{row.name} {row.unit}", *cells, *goals)
    return table


def main() -> int:
    """Print the table; no verdict."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--model", default=GENERIC, help="device model told; by default none")
    asked.add_argument("--fixed", action="store_true", help="learn no matrix")
    asked.add_argument("--seeds", type=int, default=4, help="of each simulated scene; 0 for none")
    wanted, console = asked.parse_args(), Console(width=150)
    trials = broad.trials() if broad.FOLDER.is_dir() else []
    if not trials:
        console.print(f"BROAD is not there ({broad.FOLDER}): left out", style="yellow")
    knobs = knobs_of(load_model(wanted.model))
    results = measured(trials, knobs if wanted.fixed else learning(knobs))
    simulated(results, wanted.seeds)
    console.print(shown(results))
    return 0


if __name__ == "__main__":
    sys.exit(main())
