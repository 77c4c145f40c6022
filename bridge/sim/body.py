"""Body motion of a wearer: a chain of activities, each an exact curve of attitude and velocity over time.

    attitude = (rotation of the platform, earth axes) · (attitude at the start) · (pose and sway, sensor axes)
    force    = Rᵀ (gravity up + acceleration)

attitude: unit quaternion, sensor to earth. force: specific force in m/s² that a perfect accelerometer reads.
R: rotation matrix of the attitude.
Sample i covers (t[i-1], t[i]], as in motion.py. rate[i] turns attitude[i-1] into attitude[i] exactly.
acceleration[i] changes velocity[i-1] into velocity[i] exactly.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.sim.motion import GRAVITY, TrueMotion, minimum_jerk
from bridge.sim.quaternion import Array, conjugate, from_rotvec, multiply, rotate, to_rotvec

_NOTHING = np.zeros(3)
_UP = np.array([0.0, 0.0, 1.0])
_NO_GOES = np.zeros((0, 4))
#: frequency (Hz) and decay time (s) of a knock's ringing, as of a floor under a footfall
_RING_HZ, _RING_S = 14.0, 0.05


class Activity(IntEnum):
    """Activity of a wearer and device during a stretch of time.

    The device is not worn during TABLE (it lies on a table) and HANDLED (a hand moves it).
    """

    TABLE = 0
    HANDLED = 1
    LYING = 2
    ASLEEP = 3
    SITTING = 4
    MOVING = 5
    WALKING = 6
    SLOW_TURN = 7
    BED_ADJUSTED = 8
    PUSHED = 9

    @property
    def worn(self) -> bool:
        """True if the device is worn on the body during this activity."""
        return self not in (Activity.TABLE, Activity.HANDLED)


@dataclass(frozen=True, slots=True, eq=False)
class Waves:
    """Sum of k oscillations along fixed directions, with slowly modulated phases.

    size (k, 3): amplitude vectors, in the unit of the sum. frequency_hz (k,). phase (k,): rad.
    stray (k,): amplitude of the phase modulation, rad. The modulation has a period of about seven cycles. It makes the
    motion aperiodic, as living motion is.
    """

    size: Array
    frequency_hz: Array
    phase: Array
    stray: Array

    def at(self, time_s: Array) -> Array:
        """Return the sum of the oscillations, (n, 3) in the unit of `size`. time_s (n,): s."""
        cycles = 2 * np.pi * time_s[:, None] * self.frequency_hz
        wave: Array = np.sin(cycles + self.phase + self.stray * np.sin(0.137 * cycles + 2 * self.phase)) @ self.size
        return wave


@dataclass(frozen=True, slots=True, eq=False)
class Ticks:
    """Short knocks from outside, such as footfalls, at rising times time_s (m,), s since the start of the stretch.

    tilt (m, 3): amplitude of a rotation vector, rad, sensor axes. speed (m, 3): amplitude of a velocity, m/s, earth
    axes. Both ring as a decaying sine wave after each knock.
    """

    time_s: Array
    tilt: Array
    speed: Array

    def at(self, time_s: Array) -> tuple[Array, Array]:
        """Return the tilt and velocity caused by the latest knock before each time.

        time_s (n,): s since the start of the stretch. tilt (n, 3): rotation vector, rad, sensor axes.
        velocity (n, 3): m/s, earth axes.
        """
        last = np.searchsorted(self.time_s, time_s, side="right") - 1
        since = np.where(last >= 0, time_s - self.time_s[last], np.inf)
        ring = (np.exp(-since / _RING_S) * np.sin(2 * np.pi * _RING_HZ * np.minimum(since, 1.0)))[:, None]
        return ring * self.tilt[last], ring * self.speed[last]


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """Stretch of time with one activity of a wearer, for duration_s.

    pose (3,): limb movement over the stretch, rotation vector in rad, sensor axes, along a minimum-jerk curve.
    axis (3,): unit vector in earth axes about which the platform (bed, chair, floor) turns.
    goes (m, 4): turns of the platform; per row begin s, end s, angle rad, and ramp s to reach the constant rate.
    sway: oscillating rotation vector, rad, sensor axes. bounce: oscillating velocity, m/s: ahead, left, up.
    speed: forward speed, m/s. ticks: knocks from outside, a Ticks object.
    fade_s: sway, velocity and knocks fade in and out within this time, so that all are zero at both ends.
    """

    activity: Activity
    duration_s: float
    pose: Array = field(default_factory=lambda: _NOTHING)
    axis: Array = field(default_factory=lambda: _UP)
    goes: Array = field(default_factory=lambda: _NO_GOES)
    sway: tuple[Waves, ...] = ()
    bounce: tuple[Waves, ...] = ()
    speed: float = 0.0
    fade_s: float = 1.0
    ticks: Ticks | None = None

    def rotvec(self, time_s: Array) -> Array:
        """Return the rotation vector (n, 3) of pose and sway, without knocks, in rad, sensor axes.

        time_s (n,): s since the start of the stretch.
        """
        done = minimum_jerk(time_s / self.duration_s)[:, None] * self.pose
        return np.asarray(done + self._fade(time_s) * sum(wave.at(time_s) for wave in self.sway))

    def angle(self, time_s: Array) -> Array:
        """Return the angle (n,), rad, by which the platform has turned.

        time_s (n,): s since the start of the stretch. The platform's rate is constant between the ramps of each turn.
        """
        begin, end, angle, ramp = self.goes.T
        u = np.clip(time_s[:, None], begin, end)
        up, down = np.minimum(u - begin, ramp), np.maximum(u - (end - ramp), 0.0)
        way = up**2 / 2 + ramp * np.maximum(u - begin - ramp, 0.0) - down**2 / 2
        total: Array = (way / (ramp * (end - begin - ramp))) @ angle
        return total

    def velocity(self, time_s: Array) -> Array:
        """Return the wearer's velocity (n, 3) ahead, left and up, m/s, without knocks.

        time_s (n,): s since the start of the stretch.
        """
        ahead = self.speed * np.array([1.0, 0.0, 0.0])
        return np.asarray(self._fade(time_s) * (ahead + sum(wave.at(time_s) for wave in self.bounce)))

    def knocked(self, time_s: Array) -> tuple[Array, Array]:
        """Return tilt and velocity caused by knocks from outside, faded at both ends of the stretch.

        time_s (n,): s since the start of the stretch. tilt (n, 3): rotation vector, rad, sensor axes.
        velocity (n, 3): m/s, earth axes.
        """
        nothing = np.zeros((len(time_s), 3))
        if self.ticks is None or not len(self.ticks.time_s):
            return nothing, nothing
        tilt, velocity = self.ticks.at(time_s)
        return self._fade(time_s) * tilt, self._fade(time_s) * velocity

    def _fade(self, time_s: Array) -> Array:
        fade_s = min(self.fade_s, self.duration_s / 2)
        return np.asarray(minimum_jerk(time_s / fade_s) * minimum_jerk((self.duration_s - time_s) / fade_s))[:, None]


@dataclass(frozen=True, slots=True, eq=False)
class Lived(TrueMotion):
    """True motion of a wearer's device: TrueMotion with activity and velocity.

    activity (n,) int8: values of Activity. velocity (n, 3): velocity of the sensor, m/s, earth axes.
    """

    activity: NDArray[np.int8]
    velocity: Array


class Body:
    """True motion of a wearer's device: plays stretches of activity in order, then lies on a table forever.

    lever (3,): vector from the joint about which the limb turns to the sensor, m, sensor axes.
    attitude (4,): the first attitude, quaternion wxyz, sensor to earth.
    """

    def __init__(
        self, stretches: Iterator[Stretch], lever: ArrayLike = (0, 0, 0), attitude: ArrayLike = (1, 0, 0, 0)
    ) -> None:
        self._stretches = stretches
        self._lever = np.asarray(lever, dtype=np.float64).reshape(1, 3)
        self._start = np.asarray(attitude, dtype=np.float64).reshape(1, 4)
        self._facing, self._begin_s = 0.0, 0.0
        self._stretch = self._next()
        self._time_s = 0.0
        self._attitude = self._start
        self._velocity = np.zeros((1, 3))
        self._reach = rotate(self._start, self._lever)

    def advance(self, time_s: Array) -> Lived:
        """Return the true motion at times (n,), s since the start of the motion.

        Times must be rising, later than those of all calls before, and n ≥ 1. The first interval begins at 0.
        """
        attitude, velocity, activity = self._curves(time_s)
        dt = np.diff(time_s, prepend=self._time_s)[:, None]
        before = np.concatenate([self._attitude, attitude[:-1]])
        rate = to_rotvec(multiply(conjugate(before), attitude)) / dt
        reach = rotate(attitude, self._lever)
        velocity += np.diff(reach, axis=0, prepend=self._reach) / dt
        acceleration = np.diff(velocity, axis=0, prepend=self._velocity) / dt
        force = rotate(conjugate(attitude), acceleration + GRAVITY * _UP)
        self._time_s, self._attitude = float(time_s[-1]), attitude[-1:]
        self._velocity, self._reach = velocity[-1:], reach[-1:]
        return Lived(time_s, rate, attitude, force, activity, velocity)

    def _curves(self, time_s: Array) -> tuple[Array, Array, NDArray[np.int8]]:
        n = len(time_s)
        attitude, velocity, activity = np.empty((n, 4)), np.empty((n, 3)), np.empty(n, np.int8)
        done = 0
        while True:
            end_s = self._begin_s + self._stretch.duration_s
            upto = int(np.searchsorted(time_s, end_s, side="right"))
            if upto > done:
                here = slice(done, upto)
                attitude[here], velocity[here] = self._curve(time_s[here] - self._begin_s)
                activity[here] = self._stretch.activity
            if upto == n:
                return attitude, velocity, activity
            done = upto
            self._start = self._attitude_at(np.array([self._stretch.duration_s]))
            self._start /= np.linalg.norm(self._start)
            self._facing += float(self._stretch.goes[:, 2].sum() * self._stretch.axis[2])
            self._begin_s = end_s
            self._stretch = self._next()

    def _curve(self, time_s: Array) -> tuple[Array, Array]:
        tilt, shaken = self._stretch.knocked(time_s)
        facing = self._facing + self._stretch.angle(time_s) * self._stretch.axis[2]
        velocity = rotate(from_rotvec(facing[:, None] * _UP), self._stretch.velocity(time_s)) + shaken
        return self._attitude_at(time_s, tilt), velocity

    def _attitude_at(self, time_s: Array, tilt: Array | float = 0.0) -> Array:
        limb = multiply(self._start, from_rotvec(self._stretch.rotvec(time_s) + tilt))
        if not len(self._stretch.goes):
            return limb
        return multiply(from_rotvec(self._stretch.angle(time_s)[:, None] * self._stretch.axis), limb)

    def _next(self) -> Stretch:
        return next(self._stretches, Stretch(Activity.TABLE, np.inf))
