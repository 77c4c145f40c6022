"""Simulated sessions of the comparison methods as pieces of motion: turntable, servo, and tilted poses on a desk."""

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from bridge.sim.motion import Piece, Still
from bridge.sim.motion_scripts import machine, tipped

Floats = NDArray[np.float64]
_WOBBLE_HARMONICS = 4


class Turntable(Struct, frozen=True, forbid_unknown_fields=True):
    """Turntable session: turns about each axis, in both directions, at each of the rates `rates_dps` (°/s).

    rest_s, spin_s: length of rests and spins, s.
    fixture_deg: standard deviation of the mounting angle per axis, degrees.
    """

    rates_dps: tuple[float, ...]
    rest_s: float
    spin_s: float
    fixture_deg: float

    def pieces(self, rng: np.random.Generator) -> list[Piece]:
        """Motion of the session: mounted with x, y and z up in turn, turned at each rate both ways."""
        both = tuple(sign * rate for rate in self.rates_dps for sign in (1.0, -1.0))
        return machine(askew(np.eye(3), self.fixture_deg, rng), both, rest_s=self.rest_s, spin_s=self.spin_s)


class Servomotor(Struct, frozen=True, forbid_unknown_fields=True):
    """Servo session: turns about each axis, in both directions, at the one rate `rate_dps` (°/s).

    rest_s, spin_s: length of rests and spins, s.
    fixture_deg: standard deviation of the mounting angle per axis, degrees.
    accel_offset_mg: ± limit of the offset of the calibrated accelerometer, milli-g.
    """

    rate_dps: float
    rest_s: float
    spin_s: float
    fixture_deg: float
    accel_offset_mg: float

    def pieces(self, rng: np.random.Generator) -> list[Piece]:
        """Motion of the session: mounted with x, y and z up in turn, turned at the one rate both ways."""
        mounts = askew(np.eye(3), self.fixture_deg, rng)
        return machine(mounts, (self.rate_dps, -self.rate_dps), rest_s=self.rest_s, spin_s=self.spin_s)


class AccelAided(Struct, frozen=True, forbid_unknown_fields=True):
    """Accelerometer-aided session: each of the six sides up on a desk and on inclined planes, turned by hand in between.

    inclinations_deg: inclinations of the planes, degrees.
    rest_s, move_s: length of each pose and each movement, s. wobble_deg: wobble of the hand, degrees.
    """

    inclinations_deg: tuple[float, ...]
    rest_s: float
    move_s: float
    wobble_deg: float

    def pieces(self, rng: np.random.Generator) -> list[Piece]:
        """Motion of the session: six poses for each inclination, with a turn by hand in between."""
        ups = [
            np.cos(tilt) * sign * np.eye(3)[axis] + np.sin(tilt) * np.eye(3)[(axis + 1) % 3]
            for tilt in np.radians(self.inclinations_deg)
            for axis in (2, 0, 1)
            for sign in (1.0, -1.0)
        ]
        return _through(ups, self, rng)


def _through(ups: Sequence[Floats], how: AccelAided, rng: np.random.Generator) -> list[Piece]:
    pieces: list[Piece] = [Still(how.rest_s)]
    up = ups[0]
    for then in ups[1:]:
        wobble = np.radians(how.wobble_deg) * rng.normal(size=(_WOBBLE_HARMONICS, 3)) / np.sqrt(_WOBBLE_HARMONICS)
        pieces += [tipped(up, then, how.move_s, wobble), Still(how.rest_s)]
        up = then
    return pieces


def askew(mounts: Floats, std_deg: float, rng: np.random.Generator) -> Floats:
    """Mounting directions with random errors: unit vectors (m, 3) in sensor axes.

    mounts (m, 3): exact unit vectors. std_deg: standard deviation of the tilt of each, degrees per axis.
    """
    off = mounts + np.radians(std_deg) * rng.normal(size=mounts.shape)
    return np.asarray(off / np.linalg.norm(off, axis=1)[:, None])


def turn_s(rate_dps: float, ramp_s: float = 0.5) -> float:
    """Duration of a machine's 360° turn at rate_dps (°/s), s, including its ramps (ramp_s, s)."""
    return 360.0 / abs(rate_dps) + ramp_s
