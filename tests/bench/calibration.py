"""How long one calibration takes: 27 s at 104 Hz, three turns, covariance included. `make bench`.

Medians over repetitions of one session, in milliseconds, in one process.
"""

import statistics
import sys
import time
from collections.abc import Callable

import numpy as np
from rich.console import Console
from rich.table import Table

from bridge.recording import Recording
from bridge.sim.calibration_session import simulate_session
from estimator.calibration import closure, turn360
from estimator.calibration.capture import Capture, Samples
from estimator.calibration.methods import METHODS
from estimator.calibration.result import Result
from estimator.calibration.session import CalibrationSession
from estimator.geometry import rotation
from estimator.offline import recordings
from estimator.stillness.detector import Stillness

GOAL_MS, ROUNDS = 3.0, 200


def captured(recording: Recording) -> Capture:
    """What a session hands to its method."""
    captures: list[Capture] = []

    def run(found: Capture) -> Result:
        captures.append(found)
        return METHODS["closure"](found)

    session, stillness = CalibrationSession(), Stillness()
    session._run = run
    session.add(Samples(recording.time_s, recording.gyro, recording.accel, np.zeros(len(recording), bool)))
    for window in stillness.feed(recording.time_s, recording.gyro, recording.accel):
        session.window(window)
    return captures[0]


def median_ms(job: Callable[[], object]) -> float:
    """Of one run."""
    taken = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        job()
        taken.append(time.perf_counter() - start)
    return 1e3 * statistics.median(taken)


def main() -> int:
    """Print a table; 1 when the goal is missed."""
    s = simulate_session(1, wobble_deg=2.0, rests_s=3.0, turn_s=(5.0, 5.0))
    recording = Recording(s.time_s, s.gyro, s.accel, None, s.rate_hz, "bench")
    found = captured(recording)
    n = max(len(turn.samples) for turn in found.turns)
    steps = np.random.default_rng(0).normal(0, 0.02, (3, n, 3))
    jobs = {
        "closure: start, fit, covariance": lambda: closure.estimate(found),
        "closure with its verdict": lambda: METHODS["closure"](found),
        "turn360: Algorithm 1, covariance": lambda: turn360.estimate(found),
        f"attitudes of three turns of {n} samples": lambda: rotation.chained(steps),
        "a whole recording, recognition included": lambda: recordings.calibrate(recording),
    }
    table = Table(box=None, pad_edge=False)
    for heading in (f"one session of {s.time_s[-1]:.0f} s at {s.rate_hz:g} Hz", "median ms", "goal"):
        table.add_column(heading)
    took = {name: median_ms(job) for name, job in jobs.items()}
    for name, ms in took.items():
        table.add_row(name, f"{ms:.2f}", f"≤ {GOAL_MS:g}" if name.startswith("closure") else "")
    Console().print(table)
    return int(took["closure: start, fit, covariance"] > GOAL_MS)


if __name__ == "__main__":
    sys.exit(main())
