"""Captures of simulated calibration sessions, through the same recognition as live."""

import numpy as np

from estimator.batch.capture import Capture, Samples, TurnCapture
from estimator.batch.session import CalibrationSession, Ignored, Progress, TurnFound
from estimator.stillness import Stillness
from tests.estimator.stream import Stream


def progress(of: Stream, *, accel: bool = True, clipped: slice | None = None) -> list[Progress]:
    """All that a session says of a stream."""
    flags = np.zeros(len(of), bool)
    if clipped is not None:
        flags[clipped] = True
    stillness, session = Stillness(), CalibrationSession()
    samples = Samples(of.time, of.gyro, of.accel if accel else None, flags)
    session.add(samples)
    return [p for w in stillness.feed(samples.time, samples.gyro, samples.accel) for p in session.window(w)]


def turns(of: Stream, *, accel: bool = True) -> list[TurnCapture]:
    return [p.turn for p in progress(of, accel=accel) if isinstance(p, TurnFound)]


def ignored(of: Stream, *, accel: bool = True, clipped: slice | None = None) -> list[str]:
    return [p.no_turn.reason for p in progress(of, accel=accel, clipped=clipped) if isinstance(p, Ignored)]


def capture(of: Stream, *, accel: bool = True) -> Capture:
    """The three turns of a stream, in the order x, y, z."""
    found = turns(of, accel=accel)
    x, y, z = sorted(found, key=lambda turn: turn.axis)
    return Capture(found[0].before, (x, y, z))
