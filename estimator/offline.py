"""Calibrate from a recording: the same recognition and methods as live, all at once."""

import numpy as np

from bridge.recording import Recording
from estimator.batch.capture import Samples
from estimator.batch.methods import BY_MOVEMENTS, BY_RATES, DEFAULT
from estimator.batch.result import Result
from estimator.batch.session import CalibrationSession, Finished, Ignored
from estimator.stillness import Stillness


def calibrate(
    recording: Recording, method: str = DEFAULT, gyro_range: float = 0.0, rates: tuple[float, ...] = ()
) -> tuple[Result, list[str]]:
    """The first accepted calibration in a recording, else the last that was tried; and why movements were passed over.

    A method by movements takes all of the recording at once. gyro_range in rad/s, 0 when unknown: readings at 99 % of it
    count as clipped. rates: a machine's known rates in rad/s, for the methods that need them.
    """
    limit = 0.99 * gyro_range if gyro_range else np.inf
    clipped = np.any(np.abs(recording.gyro) >= limit, axis=1)
    samples = Samples(recording.time_s, recording.gyro, recording.accel, clipped)
    if method in BY_RATES:
        return BY_RATES[method](samples, rates), []
    stillness, session = Stillness(), CalibrationSession(method, whole=method in BY_MOVEMENTS)
    session.add(samples)
    passed_over: list[str] = []
    last: Result | None = None
    for window in stillness.feed(recording.time_s, recording.gyro, recording.accel):
        for progress in session.window(window):
            if isinstance(progress, Ignored):
                passed_over.append(f"{window.end_time:.1f} s: {progress.no_turn.reason}")
            elif isinstance(progress, Finished):
                last = progress.result
                if not last.repeat:
                    return last, passed_over
    return last or session.unfinished(), passed_over
