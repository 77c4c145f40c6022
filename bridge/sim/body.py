"""A wearer's body: a chain of activities, each an exact curve of attitude and velocity that can be sampled at any times.

  attitude = (platform turned, earth axes) · (attitude at the stretch's start) · (pose and sway, sensor axes)
  force    = Rᵀ (gravity up + acceleration): what a perfect accelerometer reads

Acceleration is the change of a bounded velocity.

Convention as in motion.py: rate[i] turns attitude[i-1] into attitude[i] exactly; so does acceleration[i] with velocity.
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
    """Activity of a wearer, or of a device that is not worn (TABLE, HANDLED)."""

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
        """True if the device is on skin during this activity."""
        return self not in (Activity.TABLE, Activity.HANDLED)


@dataclass(frozen=True, slots=True, eq=False)
class Waves:
    """A sum of k oscillations along fixed directions.

    size (k, 3): amplitudes, in the unit of the sum. frequency_hz (k,). phase (k,) rad.
    stray (k,): amplitude in rad of a slow phase modulation, with a period of some seven cycles, because living motion
    is not periodic.
    """

    size: Array
    frequency_hz: Array
    phase: Array
    stray: Array

    def at(self, time_s: Array) -> Array:
        """Return the sum of the oscillations, (n, 3) in the unit of `size`, at times (n,) in s."""
        cycles = 2 * np.pi * time_s[:, None] * self.frequency_hz
        wave: Array = np.sin(cycles + self.phase + self.stray * np.sin(0.137 * cycles + 2 * self.phase)) @ self.size
        return wave


@dataclass(frozen=True, slots=True, eq=False)
class Ticks:
    """Short knocks from outside, such as footfalls, at rising times time_s (m,).

    Each knock tilts by up to tilt (m, 3) rad and pushes with speed (m, 3) m/s; both ring and decay.
    """

    time_s: Array
    tilt: Array
    speed: Array

    def at(self, time_s: Array) -> tuple[Array, Array]:
        """Return tilt (n, 3) rad and velocity (n, 3) m/s by the latest knock before each time of time_s (n,)."""
        last = np.searchsorted(self.time_s, time_s, side="right") - 1
        since = np.where(last >= 0, time_s - self.time_s[last], np.inf)
        ring = (np.exp(-since / _RING_S) * np.sin(2 * np.pi * _RING_HZ * np.minimum(since, 1.0)))[:, None]
        return ring * self.tilt[last], ring * self.speed[last]


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """One activity of a wearer, for duration_s.

    Sway and bounce fade in and out within fade_s, so that both are zero at the ends.
    pose (3,) rad: a limb movement, as a rotation vector in sensor axes, along a minimum-jerk curve.
    axis (3,), goes (m, 4): the platform (bed, chair, floor) turns about this unit vector in earth axes. A go is begin
    s, end s, angle rad, and seconds to reach the constant rate.
    sway: rad, sensor axes. bounce: m/s; ahead, left and up. speed: m/s ahead.
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
        """Return the rotation vector (n, 3), rad, of pose and sway at times (n,) s since the start.

        In sensor axes, and without knocks.
        """
        done = minimum_jerk(time_s / self.duration_s)[:, None] * self.pose
        return np.asarray(done + self._fade(time_s) * sum(wave.at(time_s) for wave in self.sway))

    def angle(self, time_s: Array) -> Array:
        """Return the angle (n,), rad, by which the platform has turned at times (n,) s since the start.

        The platform's rate is constant, except for the ramps at the start and end of each go.
        """
        begin, end, angle, ramp = self.goes.T
        u = np.clip(time_s[:, None], begin, end)
        up, down = np.minimum(u - begin, ramp), np.maximum(u - (end - ramp), 0.0)
        way = up**2 / 2 + ramp * np.maximum(u - begin - ramp, 0.0) - down**2 / 2
        total: Array = (way / (ramp * (end - begin - ramp))) @ angle
        return total

    def velocity(self, time_s: Array) -> Array:
        """Return the velocity (n, 3) ahead, left and up, m/s, at times (n,) s since the start, without knocks."""
        ahead = self.speed * np.array([1.0, 0.0, 0.0])
        return np.asarray(self._fade(time_s) * (ahead + sum(wave.at(time_s) for wave in self.bounce)))

    def knocked(self, time_s: Array) -> tuple[Array, Array]:
        """Return tilt (n, 3) rad and velocity (n, 3) m/s by knocks from outside, at times (n,) s since the start."""
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
    """True motion of a wearer's device, with activity (n,) int8 and the sensor's velocity (n, 3) m/s, earth axes."""

    activity: NDArray[np.int8]
    velocity: Array


class Body:
    """A wearer's body with a device: plays stretches in order; after the last one the device lies on a table forever.

    lever (3,): from the joint the limb turns about to the sensor, sensor axes, m. attitude: the first attitude, wxyz.
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
        """Return the true motion at times (n,) in s, n ≥ 1, rising and later than all before.

        The first call's first interval begins at 0.
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
