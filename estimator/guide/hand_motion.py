"""Hand motion tracker: from a device's readings finds how long it rests, how it lies, and how far it has turned."""

import numpy as np

from bridge.wire.messages import Floats, SampleBatch, SampleFlag
from estimator.calibration.stages import REST_S
from estimator.calibration.turn_recognition import LEAST_TURN, MOST_TURN, NUDGE
from estimator.geometry import rotation
from estimator.stillness.detector import GAP_S, NOISE_GUESS, Stillness, Window

#: smallest part of the rotation about one axis for that axis to be named during the turn
SHARE = 0.8
#: smallest part of gravity along an axis for it to count as upright
UPRIGHT = 0.8
#: a movement below this angle, rad, that ends on another face only laid the device there
_LAID = np.radians(135.0)


class Hand:
    """Motion of one device in a person's hands, from its readings: rest, turns and attitude.

    noise_guess: standard deviation of the white noise of one reading, rad/s, until measured. A new boot id resets the
    motion.
    `turned` (3,): angle turned about each axis since the last rest of at least `rest_s` seconds, rad. It is not
    corrected by the scale factors. `still_s`: duration of the present rest, s.
    Axes are 0, 1, 2 (x, y, z) in the sensor frame.
    """

    def __init__(self, noise_guess: float = NOISE_GUESS) -> None:
        self._noise_guess = noise_guess
        self.rest_s = REST_S
        self._begin(None)

    def _begin(self, boot: int | None) -> None:
        self.boot = boot
        self._stillness = Stillness(self._noise_guess)
        self._latest = self._until = -np.inf
        self._since: float | None = None
        self._sum, self._n, self._bias = np.zeros(3), 0, np.zeros(3)
        #: seconds of stillness up to now
        self.still_s = 0.0
        #: whether the device has rested long enough
        self.settled = False
        #: (3,) rad turned about each axis since the last sufficient rest
        self.turned: Floats = np.zeros(3)
        #: the axis that stands upright at rest; None while unknown
        self.upright: int | None = None
        #: whether the upright axis points down
        self.upside_down = False
        #: upright axis, and level axis along the table's edge: as gravity shows, else as the gyro carries them
        self.top, self.edge = 2, 0
        #: whether a rest was seen in this boot, so that the movement after it is known from its beginning
        self._rested = False
        #: whether the last movement only laid the device on another face
        self.laid = False
        #: (3, 3) rotation since the last sufficient rest
        self._moved: Floats = np.eye(3)

    def take(self, batch: SampleBatch) -> None:
        """Process a batch of the device's raw readings, in order; repeated and non-finite samples are ignored."""
        if batch.boot != self.boot:
            self._begin(batch.boot)
        time = batch.device_time
        fresh = (time > self._latest) & np.isfinite(batch.gyro).all(axis=1)
        if not fresh.any():
            return
        time = time[fresh]
        self._latest = float(time[-1])
        accel = None if batch.accel is None else batch.accel[fresh].astype(float)
        clipped = (batch.flags[fresh] & SampleFlag.CLIPPED) != 0
        for window in self._stillness.feed(time, batch.gyro[fresh].astype(float), accel, clipped):
            self._window(window)

    def begin_rest(self) -> None:
        """Reset the rest timer and the turned angles when a calibration begins; earlier rest is ignored."""
        self._since, self.still_s, self.settled, self.turned, self._moved = None, 0.0, False, np.zeros(3), np.eye(3)

    @property
    def rested(self) -> float:
        """Completed part of the required rest of `rest_s` seconds, from 0 to 1."""
        return min(1.0, self.still_s / self.rest_s)

    @property
    def axis(self) -> int | None:
        """Axis (0, 1, 2) of the present turn; None while the rotation is at most 30°, or spread over several axes.

        Rotation is spread if the part about its largest axis is at most 80 %.
        """
        angle = float(np.linalg.norm(self.turned))
        axis = int(np.argmax(np.abs(self.turned)))
        return axis if angle > NUDGE and abs(float(self.turned[axis])) > SHARE * angle else None

    @property
    def moved(self) -> bool:
        """True if the device has turned by more than 30° since the last rest."""
        return float(np.linalg.norm(self.turned)) > NUDGE

    def believe(self, along: int) -> None:
        """Set the axis that points along the table's edge, as shown by the turn that a person has just made.

        along: this axis, 0, 1 or 2. Ignored if this axis stands upright.
        """
        if along != self.top:
            self.edge = along

    def _window(self, window: Window) -> None:
        if window.still:
            self._rests(window)
        else:
            if self.settled:
                self.turned, self._moved = np.zeros(3), np.eye(3)
            self._since, self.still_s, self.settled = None, 0.0, False
        if not self.settled:
            since = self._until if window.start_time - self._until < GAP_S else window.start_time
            step = (window.mean - self._bias) * (window.end_time - since)
            self.turned, self._moved = self.turned + step, self._moved @ rotation.chained(step[None])[-1]
        self._until = window.end_time

    def _rests(self, window: Window) -> None:
        if self._since is None:
            self._since, self._sum, self._n = window.start_time, np.zeros(3), 0
        self._sum, self._n = self._sum + window.samples * window.mean, self._n + window.samples
        self.still_s = window.end_time - self._since
        if self.still_s < self.rest_s:
            return
        came, face = not self.settled, (self.top, self.upside_down)
        self.settled, self._bias = True, self._sum / self._n
        if window.accel_mean is not None:
            down = np.abs(window.accel_mean) / max(float(np.linalg.norm(window.accel_mean)), 1e-9)
            self.upright = int(np.argmax(down)) if down.max() > UPRIGHT else None
            self.upside_down = self.upright is not None and bool(window.accel_mean[self.upright] < 0)
        if came:
            self._put_down(face)
            self._rested = True

    def _put_down(self, face: tuple[int, bool]) -> None:
        """Find how the device lies after a movement; `face` is the axis that was upright, and whether it pointed down."""
        angle = float(np.linalg.norm(self.turned))
        whole = LEAST_TURN < angle < MOST_TURN  # as far as a gyro of unknown scale shows
        same = self.upright is None or (self.upright, self.upside_down) == face
        moved = np.eye(3) if whole and same else self._moved
        top, edge = np.abs(moved[self.top]), np.abs(moved[self.edge])  # the directions then, in axes of the device now
        self.top = int(np.argmax(top)) if self.upright is None else self.upright
        edge[self.top] = -1.0
        self.edge = int(np.argmax(edge))
        other = self.top != face[0] or (self.upright is not None and not same)
        self.laid = self._rested and self.moved and angle < _LAID and other
