"""Figure 6 of Wang et al. 2024: one simulated session, with the stages found from its readings alone."""

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from rich.console import RenderableType

from bridge.recording import Recording
from bridge.sim.paper_sessions import PaperGyro, PaperPlan, simulate
from bridge.terminal.tables import Column, Columns
from estimator.calibration.session import CalibrationSession
from estimator.calibration.session_events import TurnFound
from estimator.offline import recordings
from estimator.stillness.detector import Stillness
from estimator.study.simulation import PARAMETERS, gyro_of
from estimator.study.study import Finding, Parts, Scenario, Study, generator

_AXES = ("x", "y", "z")


class TypicalScenario(Scenario, frozen=True, kw_only=True):
    """Scenario of study `typical`: one session of the paper's simulation, with simulated gyro number `set_number`.

    Noise in °/s per reading, sample rate in Hz, times in s. turn_s: shortest and longest turn.
    """

    set_number: int
    noise_dps: float
    rate_hz: float
    rest_s: float
    turn_s: tuple[float, float]


class Stage(Struct, frozen=True):
    """Turn about one axis, simulated or found: start and end, s from the start of the session."""

    axis: str
    begin_s: float
    end_s: float


class Parameter(Struct, frozen=True):
    """Calibrated parameter: its truth, its estimate (found) by Algorithm 1, and the standard deviation of the estimate.

    The scale factors k have no unit. b is minus the bias, as in the paper, in °/s.
    """

    name: str
    truth: float
    found: float
    std: float


class Typical(Struct, frozen=True):
    """Results of the study: readings of one session, its turns as simulated and found, and the calibration.

    time_s (n): s from the start of the session. reading_dps (3, n): readings by axis, °/s.
    noise_dps: noise of a reading, °/s.
    """

    noise_dps: float
    time_s: list[float]
    reading_dps: list[list[float]]
    simulated: list[Stage]
    found: list[Stage]
    parameters: list[Parameter]
    verdict: str


def _simulated(of: TypicalScenario, gyro: PaperGyro) -> tuple[NDArray[np.float64], list[Stage]]:
    """Readings (n, 3) of the session, rad/s, and its turns."""
    plan = PaperPlan(of.noise_dps, rest_s=of.rest_s, turn_s=of.turn_s, rate_hz=of.rate_hz)
    session = simulate(gyro, plan, 1, generator(of.seed, "typical"))
    counts = (session.dt[0] > 0).sum(axis=1)
    pieces, turns, n = [session.rests[0, 0]], [], len(session.rests[0, 0])
    for i, count in enumerate(counts):
        pieces += [session.turns[0, i, :count], session.rests[0, i + 1]]
        turns.append(Stage(_AXES[i], float(n / of.rate_hz), float((n + count) / of.rate_hz)))
        n += count + len(session.rests[0, i + 1])
    return np.concatenate(pieces), turns


def results(of: TypicalScenario, _: Parts) -> Typical:
    """Simulate a session, find the turns in its readings alone (start and end in s), and calibrate by Algorithm 1."""
    truth = gyro_of(of.seed, of.set_number)
    gyro, turns = _simulated(of, truth)
    time_s = np.arange(1, len(gyro) + 1) / of.rate_hz
    recording = Recording(time_s, gyro, None, None, of.rate_hz, "typical")
    result = recordings.calibrate(recording, "turn360")[0]
    std = np.sqrt(np.diag(result.covariance))
    values = zip(
        PARAMETERS,
        [*truth.k, *-np.degrees(truth.bias)],
        [*result.scale, *-np.degrees(result.bias)],
        [*std[3:6], *np.degrees(std[:3])],
        strict=True,
    )
    return Typical(
        noise_dps=of.noise_dps,
        time_s=[round(float(t), 4) for t in time_s],
        reading_dps=[[round(float(x), 3) for x in axis] for axis in np.degrees(gyro).T],
        simulated=turns,
        found=_stages(recording),
        parameters=[Parameter(name, float(a), float(b), float(c)) for name, a, b, c in values],
        verdict=result.verdict.name.lower(),
    )


def _stages(recording: Recording) -> list[Stage]:
    """Turns that a calibration session recognises, from the rest before to the rest after."""
    session, windows = CalibrationSession("turn360"), Stillness().feed(recording.time_s, recording.gyro, None)
    session.take(windows.samples[1])
    progress = [one for begun, ended, _, still in windows.heads for one in session.judge(begun, ended, still=still)]
    turns = [one.turn for one in progress if isinstance(one, TurnFound)]
    return [Stage(_AXES[turn.axis], float(turn.before.end), float(turn.after.start)) for turn in turns]


def tables(found: Typical) -> Sequence[RenderableType]:
    """Build a table of the turns as simulated and found (s), and a table of the parameters."""
    stages = Columns(
        [Column(name, number=True) for name in ("turn about", "simulated s", "found s")],
        title=f"One simulated session, noise {found.noise_dps:g} °/s: {found.verdict}",
    )
    by_axis = {stage.axis: f"{stage.begin_s:.2f} … {stage.end_s:.2f}" for stage in found.found}
    for stage in found.simulated:
        stages.add(stage.axis, f"{stage.begin_s:.2f} … {stage.end_s:.2f}", by_axis.get(stage.axis, "not found"))
    table = Columns([Column(name, number=True) for name in ("of", "true", "found", "std")])
    for one in found.parameters:
        table.add(one.name, f"{one.truth:.5f}", f"{one.found:.5f}", f"{one.std:.5f}")
    return stages, table


def findings(found: Typical) -> Sequence[Finding]:
    """Judge figure 6 of Wang et al. 2024: it is reproduced if three turns are found with ends within 0.5 s."""
    pairs = [(a, b) for a in found.simulated for b in found.found if a.axis == b.axis]
    off = max((abs(x - y) for a, b in pairs for x, y in ((a.begin_s, b.begin_s), (a.end_s, b.end_s))), default=0.0)
    # A hand starts and ends slowly: the first and last tenths of a second of a turn are hidden by noise.
    right = len(found.found) == 3 and off < 0.5
    return (
        Finding(
            "typical",
            f"{len(found.found)} turns found, their ends to {off:.2f} s; {found.verdict}",
            "agrees" if right else "differs",
        ),
    )


STUDY = Study("typical", TypicalScenario, results, tables, findings)
