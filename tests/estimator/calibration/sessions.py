"""Captures of simulated calibration sessions, through the same recognition as live."""

import numpy as np

from bridge.reasons.catalogue import english
from bridge.sim.imu_errors import ImuSpec
from bridge.sim.motion import Still
from bridge.sim.motion_scripts import poses
from estimator.calibration.capture import Capture, Floats, TurnCapture
from estimator.calibration.gravity_propagation import COLUMN, ROW, Transitions, collect
from estimator.calibration.session import CalibrationSession
from estimator.calibration.session_events import Ignored, Progress, TurnFound
from estimator.stillness.detector import Stillness, Windows
from tests.estimator.stream import Stream, stream


def progress(of: Stream, *, accel: bool = True, clipped: slice | None = None) -> list[Progress]:
    """All that a session says of a stream."""
    flags = np.zeros(len(of), bool)
    if clipped is not None:
        flags[clipped] = True
    return fed(CalibrationSession(), Stillness().feed(of.time, of.gyro, of.accel if accel else None, flags))


def fed(session: CalibrationSession, windows: Windows) -> list[Progress]:
    """All that a session says of windows."""
    session.take(windows.samples[1])
    return [p for begun, ended, _, still in windows.heads for p in session.judge(begun, ended, still=still)]


def movements(of: Stream) -> Transitions:
    """All movements of a stream that gravity can be carried through."""
    session = CalibrationSession("transitions", whole=True)
    fed(session, Stillness().feed(of.time, of.gyro, of.accel))
    return collect(session.movements)


def in_poses(seed: int, n: int = 14, *, noise_dps: float = 0.03, accel_noise: float = 0.02, after: int = 0) -> Stream:
    """A misaligned sensor, with a biased accelerometer, laid down in n + 1 poses; then `after` s of stillness."""
    pieces = [*poses(np.random.default_rng(seed + 1000), n, rest_s=2.6), Still(after)]
    spec = ImuSpec(noise_dps=noise_dps, misalignment_deg=1.0, accel_bias=0.3, accel_noise=accel_noise)
    return stream(pieces, sum(p.duration_s for p in pieces), seed=seed, spec=spec)


def true_parameters(of: Stream) -> Floats:
    """(12,) bias, diagonal and the rest of the true matrix, in the order of a full result."""
    matrix = of.truth.matrix
    return np.concatenate([of.bias[0], matrix[ROW, COLUMN]])


def turns(of: Stream, *, accel: bool = True) -> list[TurnCapture]:
    return [p.turn for p in progress(of, accel=accel) if isinstance(p, TurnFound)]


def ignored(of: Stream, *, accel: bool = True, clipped: slice | None = None) -> list[str]:
    return [english(*p.no_turn.reason) for p in progress(of, accel=accel, clipped=clipped) if isinstance(p, Ignored)]


def capture(of: Stream, *, accel: bool = True) -> Capture:
    """The three turns of a stream, in the order x, y, z."""
    found = turns(of, accel=accel)
    x, y, z = sorted(found, key=lambda turn: turn.axis)
    return Capture(found[0].before, (x, y, z))
