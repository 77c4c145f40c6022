"""True body motion, sampled at any times: attitude, body rate and specific force.

A motion is a chain of pieces. The attitude of a piece is an exact curve of time. Sample i covers (t[i-1], t[i]].
rate[i] turns attitude[i-1] into attitude[i] exactly. Integrating the rates as constant between sample times
therefore gives the true attitude to rounding, at any sample rate.
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
    """Piece of motion that begins and ends at rest; its attitude is an exact curve of time.

    lever (3,): vector from the centre of rotation to the sensor, m, sensor axes.
    """

    @property
    def duration_s(self) -> float:
        """Duration of the piece, s."""

    @property
    def lever(self) -> tuple[float, float, float]:
        """Lever arm (3,): vector from the centre of rotation to the sensor, m, sensor axes."""

    def attitude(self, time_s: Array) -> Array:
        """Return the attitude (n, 4), quaternions wxyz, relative to the attitude at the piece's start.

        time_s (n,): s since the piece's start, 0 to duration_s.
        """


@dataclass(frozen=True, slots=True)
class Still:
    """Piece of motion at rest, for duration_s. lever (3,): lever arm in m, sensor axes."""

    duration_s: float
    lever: tuple[float, float, float] = NO_LEVER

    def attitude(self, time_s: Array) -> Array:
        """Return the identity quaternion wxyz for each time, (n, 4): a still device does not turn.

        time_s (n,): s since the piece's start.
        """
        return np.repeat(_IDENTITY, len(time_s), axis=0)


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """Rotation by `angle` rad about the unit vector `axis` (3,) in sensor axes, as turned by a hand, in duration_s.

    goes (m, 3): one row per push of the hand: begin s, end s, and share of the angle. Each push is a minimum-jerk
    curve; the shares add up to 1.
    wobble (h, 3): amplitudes of the harmonics of a rotation vector that tilts the axis, rad; zero at both ends.
    offset (3,): closure error, as a rotation vector in rad; zero for a perfect re-placement.
    lever (3,): lever arm in m, sensor axes.
    """

    duration_s: float
    axis: Array
    angle: float
    goes: Array
    wobble: Array = field(default_factory=lambda: np.zeros((1, 3)))
    offset: Array = field(default_factory=lambda: np.zeros(3))
    lever: tuple[float, float, float] = NO_LEVER

    def attitude(self, time_s: Array) -> Array:
        """Return the attitude (n, 4), quaternions wxyz, relative to the attitude at the piece's start.

        time_s (n,): s since the piece's start, 0 to duration_s.
        """
        begin, end, share = self.goes.T
        done = minimum_jerk((time_s[:, None] - begin) / (end - begin)) @ share
        spin = from_rotvec(self.angle * done[:, None] * self.axis)
        harmonics = np.sin(np.pi * done[:, None] * np.arange(1, len(self.wobble) + 1))
        tilt = from_rotvec(harmonics @ self.wobble)
        miss = from_rotvec(done[:, None] * self.offset)
        return multiply(multiply(spin, tilt), miss)


@dataclass(frozen=True, slots=True, eq=False)
class Spin:
    """Turn by a machine about the unit vector `axis` (3,) in sensor axes, in duration_s, with a constant rate.

    rate: constant rate between the ramps, rad/s. ramp_s: time to reach the rate, and to stop, s.
    lever (3,): lever arm in m, sensor axes.
    """

    duration_s: float
    axis: Array
    rate: float
    ramp_s: float = 0.5
    lever: tuple[float, float, float] = NO_LEVER

    def attitude(self, time_s: Array) -> Array:
        """Return the attitude (n, 4), quaternions wxyz, relative to the attitude at the piece's start.

        time_s (n,): s since the piece's start, 0 to duration_s.
        """
        up = np.clip(time_s, 0.0, self.ramp_s)
        down = np.clip(time_s - (self.duration_s - self.ramp_s), 0.0, self.ramp_s)
        steady = np.clip(time_s, 0.0, self.duration_s) - self.ramp_s
        angle = self.rate * (up**2 / (2 * self.ramp_s) - down**2 / (2 * self.ramp_s) + np.maximum(steady, 0.0))
        return from_rotvec(angle[:, None] * self.axis)


@dataclass(frozen=True, slots=True, eq=False)
class Swing:
    """Natural movement to another pose, in duration_s.

    The rotation vector (rad, sensor axes) is a minimum-jerk curve to the end pose, plus harmonics under a smooth
    envelope.
    pose (3,): rotation vector of the end pose, rad. sine, cosine (h, 3): amplitudes at 1, 2 … h cycles per duration,
    rad.
    lever (3,): lever arm in m, sensor axes.
    """

    duration_s: float
    pose: Array
    sine: Array
    cosine: Array
    lever: tuple[float, float, float] = NO_LEVER

    def rotvec(self, time_s: Array) -> Array:
        """Return the rotation vector (n, 3) relative to the attitude at the piece's start, rad.

        time_s (n,): s since the piece's start. The slope of the rotation vector is an upper bound of the body rate.
        """
        u = time_s / self.duration_s
        phase = 2 * np.pi * u[:, None] * np.arange(1, len(self.sine) + 1)
        envelope = np.sin(np.pi * u)[:, None] ** 2
        waves = envelope * (np.sin(phase) @ self.sine + np.cos(phase) @ self.cosine)
        return np.asarray(minimum_jerk(u)[:, None] * self.pose + waves)

    def attitude(self, time_s: Array) -> Array:
        """Return the attitude (n, 4), quaternions wxyz, relative to the attitude at the piece's start.

        time_s (n,): s since the piece's start, 0 to duration_s.
        """
        return from_rotvec(self.rotvec(time_s))


@dataclass(frozen=True, slots=True, eq=False)
class TrueMotion:
    """True motion at n samples: time, angular rate, attitude and specific force.

    time_s (n,): s. rate (n, 3): rad/s, sensor axes. attitude (n, 4): unit quaternions wxyz, sensor to earth.
    force (n, 3): specific force that a perfect accelerometer reads, m/s², sensor axes. At rest the force is 9.80665
    upwards.
    """

    time_s: Array
    rate: Array
    attitude: Array
    force: Array


class Motion:
    """True motion of a device: plays pieces of motion in order; after the last piece the device stays still forever.

    pieces: may be endless. attitude (4,): the first attitude, quaternion wxyz, sensor to earth.
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
        """Return the true motion at times (n,), s since the start of the motion, n ≥ 1.

        The first interval begins at 0. Raises ValueError if the times do not rise, within a call or from call to call.
        """
        attitude, lever = self._attitudes(time_s)
        dt = np.diff(time_s, prepend=self._time_s)[:, None]
        if not (dt > 0).all():
            raise ValueError("sample times do not increase: give increasing times, also from one call to the next")
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
    """Return the minimum-jerk curve of a hand movement: the share of the way done, from 0 to 1.

    u: time as a share of the movement's duration, in any shape; the result has the same shape and is constant outside
    0 ≤ u ≤ 1. Velocity and acceleration are zero at both ends.
    """
    u = np.clip(u, 0.0, 1.0)
    return np.asarray(u**3 * (10 - 15 * u + 6 * u * u))
