"""Poses in which a device rested, gathered from its seconds; they calibrate the accelerometer."""

from math import cos, radians

import numpy as np

from bridge.wire.messages import AccelerometerCalibration
from estimator.calibration.accelerometer import calibrated
from estimator.calibration.stages import LEAST_GRAVITY, MOST_GRAVITY
from estimator.state import Floats, StateStruct, shaped
from estimator.tracking.seconds import Second

#: s, least length of a rest
_REST_S = 1.5
#: poses closer to each other count as one
_SAME = cos(radians(30.0))
#: m/s², change of a reading that ends a rest
_CREEP = 0.1


class PosesState(StateStruct):
    """Saved state: poses (n, 5), and the rest in progress.

    poses: length of the rest, s, variance of its mean reading, m²/s⁴, and this mean (3,), m/s². rest (6,): length, s,
    number of samples, their summed variance, and their sum (3,).
    """

    poses: Floats
    rest: Floats


class RestingPoses:
    """Longest rest of a boot in each pose, gathered second by second, and the accelerometer calibration by them."""

    def __init__(self) -> None:
        self._poses, self._rest = np.empty((0, 5)), [0.0] * 6
        #: calibration by the poses so far, accepted or not; None before the first
        self.found: AccelerometerCalibration | None = None

    @property
    def state(self) -> PosesState:
        """State to save for `restore`."""
        return PosesState(self._poses, np.array(self._rest))

    def restore(self, state: PosesState) -> None:
        """Restore a saved state, and calibrate by its poses. Raises ValueError for a damaged one."""
        shaped(state.poses, -1, 5, finite=True)
        shaped(state.rest, 6, finite=True)
        if state.rest[0] and not state.rest[1] > 0:
            raise ValueError("damaged state: a rest without samples")
        self._poses, self._rest = state.poses, state.rest.tolist()
        self._calibrate()

    def take(self, second: Second) -> None:
        """Add the next second: a still one with an accelerometer lengthens the rest in progress, any other ends it."""
        if second.accel_mean is None or second.accel_std is None or second.flaw or not second.still:
            self.end_rest()
            return
        n, mean, (x, y, z) = second.samples, second.accel_mean.tolist(), second.accel_std.tolist()
        before = self._rest
        if before[0] and any(
            abs(total / before[1] - now) > _CREEP for total, now in zip(before[3:], mean, strict=True)
        ):
            self.end_rest()
        # For six numbers plain Python is faster than NumPy.
        more = second.end - second.start, n, n * ((x * x + y * y + z * z) / 3), *(n * now for now in mean)
        self._rest = [total + one for total, one in zip(self._rest, more, strict=True)]

    def end_rest(self) -> None:
        """End the rest in progress, if any, and calibrate again if it adds a pose or is the longest in its pose.

        A pose stays at least 30° from all others, so their number is bounded.
        """
        if not self._rest[0]:
            return
        (length, n, var, *total), self._rest = self._rest, [0.0] * 6
        mean = np.array(total) / n
        strength, known = float(np.linalg.norm(mean)), self._poses[:, 2:]
        if length < _REST_S or not LEAST_GRAVITY < strength < MOST_GRAVITY:
            return
        near = np.flatnonzero(known @ mean > _SAME * strength * np.linalg.norm(known, axis=1))
        if len(near) > 1 or (len(near) and length <= self._poses[near[0], 0]):
            return
        self._poses = np.vstack([np.delete(self._poses, near, axis=0), [length, var / n**2, *mean]])
        self._calibrate()

    def _calibrate(self) -> None:
        self.found = calibrated(self._poses[:, 1:]) if len(self._poses) else None
