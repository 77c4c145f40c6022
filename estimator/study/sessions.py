"""The sessions of the paper's four methods, as pieces of motion: by hand, on a turntable, tilted on a desk, on a servo."""

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from bridge.sim.motion import Piece, Still, Turn
from bridge.sim.motion_scripts import machine

Floats = NDArray[np.float64]
_WOBBLE_HARMONICS = 4


class Turntable(Struct, frozen=True, forbid_unknown_fields=True):
    """Six rates about each axis: each of rates_dps both ways. fixture_deg: how squarely it is fixed, std per axis."""

    rates_dps: tuple[float, ...]
    rest_s: float
    spin_s: float
    fixture_deg: float

    def pieces(self, rng: np.random.Generator) -> list[Piece]:
        """Fixed with x, y and z up in turn."""
        both = tuple(sign * rate for rate in self.rates_dps for sign in (1.0, -1.0))
        return machine(askew(np.eye(3), self.fixture_deg, rng), both, rest_s=self.rest_s, spin_s=self.spin_s)


class Servomotor(Struct, frozen=True, forbid_unknown_fields=True):
    """One rate both ways about each axis. accel_offset_mg: of an accelerometer calibrated beforehand, ±."""

    rate_dps: float
    rest_s: float
    spin_s: float
    fixture_deg: float
    accel_offset_mg: float

    def pieces(self, rng: np.random.Generator) -> list[Piece]:
        """Fixed with x, y and z up in turn."""
        mounts = askew(np.eye(3), self.fixture_deg, rng)
        return machine(mounts, (self.rate_dps, -self.rate_dps), rest_s=self.rest_s, spin_s=self.spin_s)


class AccelAided(Struct, frozen=True, forbid_unknown_fields=True):
    """On each of its six sides on a desk, and on planes that are inclined; turned by hand from one pose to the next."""

    inclinations_deg: tuple[float, ...]
    rest_s: float
    move_s: float
    wobble_deg: float

    def pieces(self, rng: np.random.Generator) -> list[Piece]:
        """Six poses for each inclination."""
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
        across = np.cross(then, up)
        angle = float(np.arctan2(np.linalg.norm(across), then @ up))
        if np.pi - angle < 1e-9:  # upside down: about any axis across
            across = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
        wobble = np.radians(how.wobble_deg) * rng.normal(size=(_WOBBLE_HARMONICS, 3)) / np.sqrt(_WOBBLE_HARMONICS)
        goes = np.array([[0.0, how.move_s, 1.0]])
        pieces += [Turn(how.move_s, across / np.linalg.norm(across), angle, goes, wobble), Still(how.rest_s)]
        up = then
    return pieces


def askew(mounts: Floats, std_deg: float, rng: np.random.Generator) -> Floats:
    """(m, 3) unit vectors up in the sensor, each off by std_deg per axis across it."""
    off = mounts + np.radians(std_deg) * rng.normal(size=mounts.shape)
    return np.asarray(off / np.linalg.norm(off, axis=1)[:, None])


def turn_s(rate_dps: float, ramp_s: float = 0.5) -> float:
    """How long a machine turns 360°, its ramps up and down among it."""
    return 360.0 / abs(rate_dps) + ramp_s
