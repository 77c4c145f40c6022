"""Poses in which a device rested, collected from one-second blocks of samples; they calibrate the accelerometer."""

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
    """Saved state of RestingPoses: known poses (m, 5) and the rest in progress (6,).

    poses, each row: length of the rest, s; variance of its mean reading, (m/s²)²; mean reading (3), m/s².
    rest: length, s; number of samples; sum of their variances, (m/s²)²; sum of their readings (3), m/s².
    Accelerometer readings are in the sensor frame.
    """

    poses: Floats
    rest: Floats


class RestingPoses:
    """Longest rest of a boot in each pose, and the accelerometer calibration computed from these rests.

    `found`: the calibration, accepted or not; None before the first rest.
    """

    def __init__(self) -> None:
        self._poses, self._rest = np.empty((0, 5)), [0.0] * 6
        #: calibration by the poses so far, accepted or not; None before the first
        self.found: AccelerometerCalibration | None = None

    @property
    def state(self) -> PosesState:
        """Poses and the rest in progress, as state to save for `restore`."""
        return PosesState(self._poses, np.array(self._rest))

    def restore(self, state: PosesState) -> None:
        """Restore a saved state, and compute the calibration from its poses.

        Raises ValueError if the state is damaged.
        """
        shaped(state.poses, -1, 5, finite=True)
        shaped(state.rest, 6, finite=True)
        if state.rest[0] and not state.rest[1] > 0:
            raise ValueError("damaged state: a rest has no samples; start without this state")
        self._poses, self._rest = state.poses, state.rest.tolist()
        self._calibrate()

    def take(self, second: Second) -> None:
        """Process a block of samples, about one second long: extend the rest in progress, or end it.

        A still, faultless block with accelerometer data extends the rest; any other block ends it. If the mean reading
        has changed by more than 0.1 m/s² on an axis, the block begins a new rest.
        """
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
        """End the rest in progress, if any; recalibrate the accelerometer if it is the first or longest rest in its pose.

        Poses lie at least 30° apart, so their number is bounded.
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
