"""Random good and bad calibration sessions by the thousand: counts good sessions refused and wrong results accepted."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from bridge.recording import Recording
from bridge.sim.calibration_session import Session, simulate_session
from bridge.sim.imu_errors import ImuSpec
from bridge.sim.motion_scripts import TurnPlan
from bridge.terminal.tables import Column, Columns
from bridge.wire.messages import Verdict
from estimator.calibration.axis_alignment import MAPPINGS
from estimator.calibration.result import Result
from estimator.device.session_knobs import SessionKnobs
from estimator.offline import recordings
from estimator.study.worker_processes import started

Floats = NDArray[np.float64]
Rng = np.random.Generator
ODD = ImuSpec(scale=(0.95, 1.05), bias_limit_dps=5.0)
SPOILT = ImuSpec(scale=(0.9, 1.1), bias_limit_dps=2.0)
#: (3, 3) axis mappings other than the sensor's own; without mirrored z, which hardly shows in these sessions
FOREIGN = [m for m in MAPPINGS[1:] if not np.array_equal(m, np.diag([1.0, 1.0, -1.0]))]


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """Simulated session as a recording, with its true scale factors k (3,), no unit.

    k: None for a session that no method can calibrate correctly; each acceptance is then wrong.
    knobs: facts about the device and its turns that the calibration is given; None for none.
    """

    recording: Recording
    k: Floats | None
    knobs: SessionKnobs | None = None


def good(seed: int) -> Trial:
    """Simulate a good session, which a calibration should accept; the seed determines all random choices.

    Order, direction and rate of the turns, bias, scale factors, hand errors and resolution are random. Odd seeds have
    an accelerometer.
    """
    rng = np.random.default_rng(seed)
    turns = tuple(
        TurnPlan(int(axis), 360.0 * rng.choice([-1, 1]), goes=int(rng.integers(1, 5))) for axis in rng.permutation(3)
    )
    session = simulate_session(
        seed,
        noise_dps=float(rng.choice([0.01, 0.03, 0.15])),
        wobble_deg=float(rng.uniform(0, 3)),
        tilt_deg=float(rng.uniform(0, 5)),
        replacement_deg=float(rng.uniform(0, 0.3)),
        rate_hz=float(rng.choice([50.0, 104.0, 200.0])),
        rests_s=(float(rng.uniform(3, 8)), 3.0, float(rng.uniform(3, 5)), 3.0),
        turns=turns,
        turn_s=(3.0, 8.0),
        spec=ImuSpec(scale=(0.75, 1.35), bias_limit_dps=10.0, step_dps=float(rng.choice([0.0, 0.0076, 0.061]))),
    )
    return _trial(session, session.truth.k, accel=bool(seed % 2))


def _odd(turns: Callable[[Rng], tuple[TurnPlan, ...]], *, accel: bool | None = None) -> Callable[[int], Trial]:
    def make(seed: int) -> Trial:
        rng = np.random.default_rng(seed)
        session = simulate_session(seed, turns=turns(rng), spec=ODD, wobble_deg=float(rng.uniform(0, 3)))
        return _trial(session, session.truth.k, accel=bool(seed % 2) if accel is None else accel)

    return make


def _missing(rng: Rng) -> tuple[TurnPlan, ...]:
    axes = rng.permutation(3)[:2]
    return tuple(TurnPlan(int(axis)) for axis in rng.choice(axes, 3))


def _horizontal(rng: Rng) -> tuple[TurnPlan, ...]:
    # A horizontal axis of a device lying flat; the wrong turn comes last, since after it the device lies on its side.
    odd = int(rng.integers(0, 2))
    angle = float(rng.choice([180.0, 270.0, 330.0, 345.0, 390.0, 540.0, 720.0]) * rng.choice([-1, 1]))
    return (*(TurnPlan(axis) for axis in (1 - odd, 2)), TurnPlan(odd, angle))


def _vertical(rng: Rng) -> tuple[TurnPlan, ...]:
    return TurnPlan(0), TurnPlan(1), TurnPlan(2, float(rng.choice([90.0, 180.0, 720.0, 1080.0])))


def _swings(rng: Rng) -> tuple[TurnPlan, ...]:
    return tuple(TurnPlan(int(rng.integers(0, 3)), float(rng.uniform(200, 500)), swing=True) for _ in range(6))


def _slow(rng: Rng) -> tuple[TurnPlan, ...]:
    return tuple(TurnPlan(int(axis), duration_s=float(rng.uniform(16, 40))) for axis in rng.permutation(3))


def _lost(session: Session, rng: Rng) -> Recording:
    turn = _stage(session, 1 + 2 * int(rng.integers(0, 3)))
    keep = np.ones(len(session.time_s), bool)
    at = int(rng.integers(turn.start, turn.stop - 60))
    keep[at : at + int(rng.integers(5, 60))] = False
    whole = _trial(session, session.truth.k, accel=True).recording
    accel = None if whole.accel is None else whole.accel[keep]
    return replace(whole, time_s=whole.time_s[keep], gyro=whole.gyro[keep], accel=accel)


def _clipped(session: Session, rng: Rng) -> Recording:
    turn = _stage(session, 1 + 2 * int(rng.integers(0, 3)))
    limit = float(rng.uniform(0.3, 0.95)) * float(np.abs(session.gyro[turn]).max())
    return _with(session, np.clip(session.gyro, -limit, limit))


def _moved_while_still(session: Session, rng: Rng) -> Recording:
    gyro = session.gyro.copy()
    gyro[_stage(session, 2 * int(rng.integers(0, 4)))] += np.radians(rng.uniform(0.3, 5.0)) * rng.choice([-1, 1], 3)
    return _with(session, gyro)


def _bias_jump(session: Session, rng: Rng) -> Recording:
    gyro = session.gyro.copy()
    turn = _stage(session, 1 + 2 * int(rng.integers(0, 3)))
    gyro[turn.start + 50 :] += np.radians(rng.uniform(0.3, 5.0)) * rng.choice([-1, 1], 3)
    return _with(session, gyro)


def _pushed(seed: int) -> Trial:
    """Turns in several quick pushes, clipped at a range that is not declared."""
    rng = np.random.default_rng(seed)
    turns = tuple(TurnPlan(int(axis), 360.0, goes=int(rng.integers(2, 6))) for axis in rng.permutation(3))
    session = simulate_session(
        seed, turns=turns, turn_s=(2.5, 4.0), spec=SPOILT, noise_dps=float(rng.choice([0.01, 0.07]))
    )
    limit = float(rng.uniform(0.4, 0.95)) * float(np.abs(session.gyro).max())
    return Trial(_with(session, np.clip(session.gyro, -limit, limit)), session.truth.k)


def _warming(session: Session, rng: Rng) -> Recording:
    drift = np.radians(rng.uniform(0.2, 3.0)) * rng.choice([-1, 1], 3) * session.time_s[:, None] / session.time_s[-1]
    return _with(session, session.gyro + drift)


def _misaligned(seed: int) -> Trial:
    rng = np.random.default_rng(seed)
    askew = replace(SPOILT, misalignment_deg=float(rng.uniform(0.2, 1.15)))
    session = simulate_session(seed, spec=askew, tilt_deg=3.0, wobble_deg=1.0, replacement_deg=0.2)
    return _trial(session, session.truth.k, accel=bool(seed % 2))


def _vertical_wrong(rng: Rng) -> tuple[TurnPlan, ...]:
    return TurnPlan(0), TurnPlan(1), TurnPlan(2, float(rng.uniform(340.0, 380.0)))


def _all_wrong(rng: Rng) -> tuple[TurnPlan, ...]:
    return tuple(TurnPlan(int(axis), float(rng.uniform(345.0, 375.0))) for axis in rng.permutation(3))


def _level(seed: int) -> Trial:
    """A vertical turn of a wrong angle, where only turns about a horizontal axis count."""
    trial = _odd(_vertical_wrong, accel=True)(seed)
    return replace(trial, knobs=SessionKnobs(horizontal_turns=True))


def _spoilt(spoil: Callable[[Session, Rng], Recording]) -> Callable[[int], Trial]:
    def make(seed: int) -> Trial:
        session = simulate_session(seed, spec=SPOILT)
        return Trial(spoil(session, np.random.default_rng(seed)), session.truth.k)

    return make


def _never(change: Callable[[Session, Rng], Recording]) -> Callable[[int], Trial]:
    def make(seed: int) -> Trial:
        rng = np.random.default_rng(seed)
        return Trial(change(simulate_session(seed, spec=ODD, wobble_deg=float(rng.uniform(0, 3))), rng), None)

    return make


BAD: dict[str, Callable[[int], Trial]] = {
    "a turn is missing": _odd(_missing),
    "a wrong angle about a horizontal axis": _odd(_horizontal, accel=True),
    "half or double about the vertical": _odd(_vertical),
    "swings instead of turns": _odd(_swings),
    "turned for 16 to 40 s": _odd(_slow),
    "samples lost in a turn": _spoilt(_lost),
    "clipped, not flagged": _spoilt(_clipped),
    "clipped in pushes, not flagged": _pushed,
    "warming up": _spoilt(_warming),
    "axes misaligned by up to 2 %": _misaligned,
    "a wrong angle about the vertical, not allowed": _level,
    "moved while still": _spoilt(_moved_while_still),
    "the bias jumps": _spoilt(_bias_jump),
    "axes swapped or mirrored": _never(lambda s, rng: _with(s, s.gyro @ rng.choice(FOREIGN).T)),
    "degrees instead of radians": _never(lambda s, _: _with(s, np.degrees(s.gyro))),
    "radians instead of degrees": _never(lambda s, _: _with(s, np.radians(s.gyro))),
    "half or double the rate": _never(lambda s, rng: _faster(s, float(rng.choice([0.5, 2.0])))),
}


#: faults that hardly show in a recording, or not at all: the result states the condition under which it is right
UNDETECTABLE: dict[str, Callable[[int], Trial]] = {
    "a wrong angle about the vertical": _odd(_vertical_wrong, accel=True),
    "the axis of the vertical turn mirrored": _never(lambda s, _: _with(s, s.gyro * (1.0, 1.0, -1.0))),
    "wrong angles, no accelerometer": _odd(_all_wrong, accel=False),
}


def is_wrong(result: Result, k: Floats | None) -> bool:
    """Return True if a result is accepted but wrong: a scale factor is off by more than 1 % and 4 standard deviations.

    k (3,): true scale factors; with None every accepted result is wrong.
    """
    return result.verdict is Verdict.ACCEPTED and (k is None or _is_off(result, k, 0.01, 4.0))


def is_too_sure(result: Result, k: Floats | None) -> bool:
    """Return True if a result is accepted with a scale factor off by more than 0.2 % and 5 standard deviations.

    Its covariance is then too small. k (3,): true scale factors; None gives False.
    """
    return result.verdict is Verdict.ACCEPTED and k is not None and _is_off(result, k, 0.002, 5.0)


def _is_off(result: Result, k: Floats, by: float, deviations: float) -> bool:
    error, std = np.abs(result.scale - k), np.sqrt(np.diag(result.covariance)[3:6])
    return bool(np.any((error > by) & (error > deviations * std)))


def try_one(job: tuple[str, int, str]) -> tuple[str, bool, bool, bool]:
    """Simulate one session of a job (kind, seed, method) and calibrate it.

    Returns (kind, accepted, wrong, too sure). The last three are True or False, see `is_wrong` and `is_too_sure`.
    """
    kind, seed, method = job
    trial = (good if kind == GOOD else {**BAD, **UNDETECTABLE}[kind])(seed)
    result, _ = recordings.calibrate(trial.recording, method, knobs=trial.knobs)
    return kind, result.verdict is Verdict.ACCEPTED, is_wrong(result, trial.k), is_too_sure(result, trial.k)


GOOD = "good"


def run(console: Console, runs: int, method: str, workers: int | None) -> None:
    """Calibrate `runs` good and `runs` bad sessions in parallel, and print a table of the results.

    method: calibration method. workers: number of processes; None for one per processor.
    A fifth as many sessions with undetectable faults are added; their results are not counted as wrong.
    """
    kinds, undetectable = list(BAD), list(UNDETECTABLE)
    jobs = [(GOOD, seed, method) for seed in range(runs)]
    jobs += [(kinds[seed % len(kinds)], seed, method) for seed in range(runs)]
    jobs += [(undetectable[seed % len(undetectable)], seed, method) for seed in range(runs // 5)]
    seen, accepted, wrong, too_sure = Counter[str](), Counter[str](), Counter[str](), Counter[str]()
    with started(workers) as pool:
        found = pool.imap_unordered(try_one, jobs, chunksize=16)
        for kind, was_accepted, was_wrong, was_too_sure in track(
            found, "calibrating", total=len(jobs), console=console, transient=True
        ):
            seen[kind] += 1
            accepted[kind] += was_accepted
            wrong[kind] += was_wrong
            too_sure[kind] += was_too_sure
    numbers = (Column(heading, number=True) for heading in ("sessions", "accepted", "wrong", "too sure"))
    table = Columns([Column("protocol"), *numbers], title=f"Protocols at random, method {method}")
    for kind in (GOOD, *kinds):
        table.add(kind, *(str(count[kind]) for count in (seen, accepted, wrong, too_sure)))
    for kind in undetectable:
        table.add(f"undetectable: {kind}", *(str(count[kind]) for count in (seen, accepted, wrong, too_sure)))
    console.print(table)
    console.print(
        "wrong: accepted, although a scale factor is off by more than 1 % and 4 std, or no result could be right. "
        "too sure: off by more than 0.2 % and 5 std"
    )
    refused, accepted_wrong = runs - accepted[GOOD], sum(wrong[kind] for kind in (GOOD, *kinds))
    console.print(
        f"{refused} of {runs} good sessions refused ({100 * refused / runs:.2f} %); {accepted_wrong} wrong ones accepted. "
        "Undetectable ones do not count: their results state that each turn is assumed to be exactly 360°"
    )


def _trial(session: Session, k: Floats, *, accel: bool) -> Trial:
    s = session
    return Trial(Recording(s.time_s, s.gyro, s.accel if accel else None, None, s.rate_hz, "simulated"), k)


def _with(session: Session, gyro: Floats) -> Recording:
    return replace(_trial(session, session.truth.k, accel=True).recording, gyro=gyro)


def _faster(session: Session, factor: float) -> Recording:
    whole = _trial(session, session.truth.k, accel=False).recording
    return replace(whole, time_s=whole.time_s / factor, rate_hz=whole.rate_hz * factor)


def _stage(session: Session, number: int) -> slice:
    return slice(*session.stages[number])
