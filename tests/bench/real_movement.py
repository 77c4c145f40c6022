"""Bias and orientation on BROAD's real movement, every trial that is there, beside VQF and the limits. `make bench-broad`.

Medians over the trials, in their moving phases: bias (°/s rms per axis) as recorded, with no rest first, and with a ramp of
0.05 °/s a minute; heading drift from the second minute of movement on, in which a matrix may have been learnt; total
orientation error; and NEES per axis. A bias that walks four times as fast as the model says is simulated.
Nothing is told of the sensors unless --model says so: truerate is run as `truerate correct --learn-matrix` runs.
The other rows are limits: see limits.py.
"""

import argparse
import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bridge.recording import Recording
from estimator.config.device_settings import knobs_of, learning
from estimator.device.session_knobs import SessionKnobs
from estimator.noise.device_model import GENERIC, load_model
from estimator.offline.recordings import correct
from tests.bench import broad
from tests.bench.limits import HURRY, Found, methods, walking
from tests.bench.orientation import errors
from tests.bench.trackers import Floats
from tests.sim.day import simulate_day, worn_spec
from tests.sim.scenes import rests_and_motion

#: s of movement in which a matrix may be learnt before the heading's drift counts
LEARNING_S = 60.0
RECORDED, NO_REST, RAMP = broad.SCENARIOS[:3]
DRIFT, TOTAL, INCLINATION = "heading drift", "total", "inclination"


@dataclass(frozen=True, slots=True)
class Question:
    """A column: its goals in real time and smoothed; NaN for none."""

    name: str
    unit: str
    goal: float = np.nan
    goal_smoothed: float = np.nan


#: a table each
QUESTIONS = (
    (
        Question(RECORDED, "°/s", 0.0032, 0.0018),
        Question(NO_REST, "°/s", 0.084, 0.004),
        Question(RAMP, "°/s", 0.033),
        Question(f"NEES, {RECORDED}", "", 1.0),
        Question(f"NEES, {NO_REST}", "", 1.0),
    ),
    (
        Question(DRIFT, "°/min", 1.3, 1.0),
        Question(TOTAL, "°", 1.8, 1.3),
        Question(INCLINATION, "°", 0.5, 0.38),
    ),
    tuple(Question(f"NEES, walk ×{times:g}, {what}", "", 1.0) for what in ("rests", "day") for times in (1.0, HURRY)),
)

#: question, method, values by trial or seed
Results = dict[str, dict[str, dict[str, float]]]


def judge(name: str, found: Found, trial: broad.Trial) -> Iterator[tuple[str, float]]:
    """Values of a scenario's questions, of what a method gives."""
    if found.bias is not None:
        yield name, trial.rmse_dps(found.bias)
        if found.std is not None:
            yield f"NEES, {name}", nees(found, trial.bias, trial.moving)
    if found.quat_wxyz is None or name != RECORDED:
        return
    first = int(np.argmax(trial.moving))
    inclination, heading = errors(found.quat_wxyz, trial.attitude, slice(0, first))
    at = trial.moving & np.isfinite(inclination)
    later = at & (np.arange(len(at)) > first + LEARNING_S * trial.rate_hz)
    minutes = np.flatnonzero(later) / trial.rate_hz / 60
    yield DRIFT, float(abs(np.polyfit(minutes, np.degrees(np.unwrap(heading[later])), 1)[0]))
    for question, square in ((TOTAL, inclination**2 + heading**2), (INCLINATION, inclination**2)):
        yield question, float(np.degrees(np.sqrt(np.mean(square[at]))))


def nees(found: Found, bias: Floats, counted: NDArray[np.bool_]) -> float:
    """Mean over samples and axes of squared error by variance."""
    assert found.bias is not None
    assert found.std is not None
    return float(np.mean(((found.bias - bias) / found.std)[counted] ** 2))


def measured(trials: list[broad.Trial], knobs: SessionKnobs) -> Results:
    """Every question of real movement, by method and trial."""
    results: Results = defaultdict(lambda: defaultdict(dict))
    tried = methods(knobs, broad.walk(trials)) if trials else {}
    for trial in trials:
        results[RECORDED]["the truth itself"][trial.name] = broad.truth_std_dps(trial)
        for name in (RECORDED, NO_REST, RAMP):
            changed = broad.scenario(name, trial)
            for method, run in tried.items():
                for question, value in judge(name, run(changed), changed):
                    results[question][method][trial.name] = value
    return results


def simulated(results: Results, seeds: int) -> None:
    """NEES where the bias walks as the model says, and faster: rests and movement in turn, and wearers' hours."""
    knobs = knobs_of(load_model("icm-20948"))
    own = knobs.track.bias.rate_random_walk
    for times in (1.0, HURRY):
        for seed in range(3000, 3000 + seeds):
            walk_dps = times * float(np.degrees(own))
            rests = rests_and_motion(seed, 900.0, rrw_dps_per_sqrt_s=walk_dps)
            worn = simulate_day(seed, 0.5, 52.0, replace(worn_spec(52.0), rrw_dps_per_sqrt_s=walk_dps))
            for what, day in (("rests", rests), ("day", worn)):
                told = replace(
                    Recording.from_arrays(day.gyro.astype(float), day.accel.astype(float), rate_hz=day.rate_hz),
                    temperature_c=day.temperature_c.astype(float),
                )
                for method, by in {"truerate": knobs, "told the walk": walking(knobs, times * own)}.items():
                    c = correct(told, knobs=by)
                    found = Found(c.bias.astype(float), c.bias_std.astype(float))
                    value = nees(found, day.bias.astype(float), day.time_s > 60)
                    results[f"NEES, walk ×{times:g}, {what}"][method][str(seed)] = value


def shown(results: Results) -> Iterator[Table]:
    """Medians, and the worst."""
    for questions in QUESTIONS:
        table = Table(title="medians (worst)", title_justify="left", title_style="bold", box=None, pad_edge=False)
        table.add_column("")
        for question in questions:
            table.add_column(f"{question.name}\n{question.unit}", justify="right", no_wrap=True)
        for row, goals in (
            ("goal", [q.goal for q in questions]),
            ("goal, smoothed", [q.goal_smoothed for q in questions]),
        ):
            table.add_row(row, *("–" if np.isnan(goal) else f"{goal:g}" for goal in goals))
        for method in dict.fromkeys(method for question in questions for method in results[question.name]):
            values = [list(results[question.name].get(method, {}).values()) for question in questions]
            table.add_row(method, *(f"{np.median(of):.4f} ({max(of):.3f})" if of else "–" for of in values))
        yield table


def main() -> int:
    """Print the tables; no verdict."""
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
    for table in shown(results):
        console.print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
