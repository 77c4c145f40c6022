"""True body motion, sampled at any times: attitude, body rate and specific force.

A motion is a chain of pieces, each an exact curve of attitude. Convention: sample i covers (t[i-1], t[i]], and rate[i]
turns attitude[i-1] into attitude[i] exactly. Integrating the rates as constant between sample times gives the true
attitude to rounding, however coarse the samples.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from bridge.sim.quaternion import Array, conjugate, from_rotvec, multiply, to_rotvec, up_in_body

GRAVITY = 9.80665
NO_LEVER = (0.0, 0.0, 0.0)
_IDENTITY = np.array([[1.0, 0.0, 0.0, 0.0]])


class Piece(Protocol):
    """A piece of motion that begins and ends at rest; its attitude is an exact curve of time.

    lever: from the centre of rotation to the sensor, sensor axes, m.
    """

    @property
    def duration_s(self) -> float:
        """Duration of the piece in s."""

    @property
    def lever(self) -> tuple[float, float, float]:
        """Lever arm from the centre of rotation to the sensor, sensor axes, m."""

    def attitude(self, time_s: Array) -> Array:
        """Return the attitude (n, 4) wxyz at times (n,) in 0 to duration_s, relative to the piece's own start."""


@dataclass(frozen=True, slots=True)
class Still:
    """A piece of motion at rest, for duration_s."""

    duration_s: float
    lever: tuple[float, float, float] = NO_LEVER

    def attitude(self, time_s: Array) -> Array:
        """Return the unchanged attitude (n, 4) wxyz, the identity, at times (n,) in s since the piece's start."""
        return np.repeat(_IDENTITY, len(time_s), axis=0)


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """A rotation by `angle` rad about the unit `axis` (3,), along the path of a hand.

    goes (m, 3): begin s, end s and share of each push. Each push is a minimum-jerk curve; the shares add up to 1.
    wobble (h, 3): harmonics, in rad, of a tilt across the path that is zero at both ends. Wobble moves the axis but not
    the end attitude.
    offset (3,): small rotation, rad, by which the end misses; zero for a perfect re-placement.
    """

    duration_s: float
    axis: Array
    angle: float
    goes: Array
    wobble: Array = field(default_factory=lambda: np.zeros((1, 3)))
    offset: Array = field(default_factory=lambda: np.zeros(3))
    lever: tuple[float, float, float] = NO_LEVER

    def attitude(self, time_s: Array) -> Array:
        """Return the attitude (n, 4) wxyz at times (n,) in s since the piece's start, relative to that start."""
        begin, end, share = self.goes.T
        done = minimum_jerk((time_s[:, None] - begin) / (end - begin)) @ share
        spin = from_rotvec(self.angle * done[:, None] * self.axis)
        harmonics = np.sin(np.pi * done[:, None] * np.arange(1, len(self.wobble) + 1))
        tilt = from_rotvec(harmonics @ self.wobble)
        miss = from_rotvec(done[:, None] * self.offset)
        return multiply(multiply(spin, tilt), miss)


@dataclass(frozen=True, slots=True, eq=False)
class Spin:
    """A machine turn about the unit `axis` (3,): up to `rate` rad/s within ramp_s, constant, and down again."""

    duration_s: float
    axis: Array
    rate: float
    ramp_s: float = 0.5
    lever: tuple[float, float, float] = NO_LEVER

    def attitude(self, time_s: Array) -> Array:
        """Return the attitude (n, 4) wxyz at times (n,) in s since the piece's start, relative to that start."""
        up = np.clip(time_s, 0.0, self.ramp_s)
        down = np.clip(time_s - (self.duration_s - self.ramp_s), 0.0, self.ramp_s)
        steady = np.clip(time_s, 0.0, self.duration_s) - self.ramp_s
        angle = self.rate * (up**2 / (2 * self.ramp_s) - down**2 / (2 * self.ramp_s) + np.maximum(steady, 0.0))
        return from_rotvec(angle[:, None] * self.axis)


@dataclass(frozen=True, slots=True, eq=False)
class Swing:
    """Natural movement: the rotation vector is a sum of harmonics under a smooth envelope, plus a net change of pose.

    pose (3,) rad: the end pose. sine, cosine (h, 3) rad: amplitudes at 1, 2 … h cycles per duration.
    """

    duration_s: float
    pose: Array
    sine: Array
    cosine: Array
    lever: tuple[float, float, float] = NO_LEVER

    def rotvec(self, time_s: Array) -> Array:
        """Return the rotation vector (n, 3), rad, at times (n,) in s, relative to the start of the piece.

        The rotation vector's slope is an upper bound of the body rate.
        """
        u = time_s / self.duration_s
        phase = 2 * np.pi * u[:, None] * np.arange(1, len(self.sine) + 1)
        envelope = np.sin(np.pi * u)[:, None] ** 2
        waves = envelope * (np.sin(phase) @ self.sine + np.cos(phase) @ self.cosine)
        return np.asarray(minimum_jerk(u)[:, None] * self.pose + waves)

    def attitude(self, time_s: Array) -> Array:
        """Return the attitude (n, 4) wxyz at times (n,) in s since the piece's start, relative to that start."""
        return from_rotvec(self.rotvec(time_s))


@dataclass(frozen=True, slots=True, eq=False)
class TrueMotion:
    """True motion at n samples: time_s (n,), rate (n, 3) rad/s in body axes, attitude (n, 4) wxyz sensor -> earth.

    force (n, 3) m/s², sensor axes: the specific force a perfect accelerometer reads: gravity (9.80665 up at rest) plus
    the acceleration of the lever arm.
    """

    time_s: Array
    rate: Array
    attitude: Array
    force: Array


class Motion:
    """Plays pieces of motion in order and on demand; after the last piece the device stays still forever.

    pieces may be endless. attitude: the first attitude, wxyz.
    """

    def __init__(self, pieces: Iterable[Piece], attitude: ArrayLike = (1.0, 0.0, 0.0, 0.0)) -> None:
        self._pieces = iter(pieces)
        self._start = np.array(attitude, dtype=np.float64).reshape(1, 4)
        self._begin_s = 0.0
        self._piece = next(self._pieces, Still(np.inf))
        self._time_s = 0.0
        self._attitude = self._start
        self._rate = np.zeros((1, 3))

    def advance(self, time_s: Array) -> TrueMotion:
        """Return the true motion at times (n,) in s, n ≥ 1, rising and later than all before.

        The first call's first interval begins at 0. Raises ValueError if the times do not rise.
        """
        attitude, lever = self._attitudes(time_s)
        dt = np.diff(time_s, prepend=self._time_s)[:, None]
        if not (dt > 0).all():
            raise ValueError("sample times must rise, within a call and from one call to the next")
        before = np.concatenate([self._attitude, attitude[:-1]])
        rate = to_rotvec(multiply(conjugate(before), attitude)) / dt
        turning = np.diff(rate, axis=0, prepend=self._rate) / dt
        force = GRAVITY * up_in_body(attitude) + np.cross(rate, np.cross(rate, lever)) + np.cross(turning, lever)
        self._time_s, self._attitude, self._rate = float(time_s[-1]), attitude[-1:], rate[-1:]
        return TrueMotion(time_s, rate, attitude, force)

    def _attitudes(self, time_s: Array) -> tuple[Array, Array]:
        attitude, lever = np.empty((len(time_s), 4)), np.empty((len(time_s), 3))
        done = 0
        while done < len(time_s):
            end_s = self._begin_s + self._piece.duration_s
            upto = int(np.searchsorted(time_s, end_s, side="right"))
            if upto > done:
                here = slice(done, upto)
                attitude[here] = multiply(self._start, self._piece.attitude(time_s[here] - self._begin_s))
                lever[here] = self._piece.lever
                done = upto
            if done < len(time_s):
                self._next_piece(end_s)
        return attitude, lever

    def _next_piece(self, end_s: float) -> None:
        last = self._piece.attitude(np.array([self._piece.duration_s]))
        start = multiply(self._start, last)
        self._start = start / np.linalg.norm(start)
        self._begin_s = end_s
        self._piece = next(self._pieces, Still(np.inf))


def minimum_jerk(u: Array) -> Array:
    """Return the minimum-jerk curve of a hand's movement, from 0 to 1, at u (any shape); constant outside 0 ≤ u ≤ 1.

    Velocity and acceleration are zero at both ends.
    """
    u = np.clip(u, 0.0, 1.0)
    return np.asarray(u**3 * (10 - 15 * u + 6 * u * u))
