"""Units that a profile may name, with their SI factors."""

from collections.abc import Mapping
from math import radians
from typing import Final

from bridge.toml.loader import nearest

STANDARD_GRAVITY: Final = 9.80665
COUNTS: Final = "counts"
RATES: Final[Mapping[str, float]] = {"rad/s": 1.0, "mrad/s": 1e-3, "dps": radians(1), "mdps": radians(1e-3)}
ACCELERATIONS: Final[Mapping[str, float]] = {"m/s2": 1.0, "g": STANDARD_GRAVITY, "mg": STANDARD_GRAVITY * 1e-3}
TIMES: Final[Mapping[str, float]] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def in_si(unit: str, units: Mapping[str, float], sensitivity: float | None, key: str) -> float:
    """SI value of one `unit`, or of one count of a sensor with this sensitivity (already SI).

    key: the sensitivity's name in the file. Raises ValueError with what is expected.
    """
    if unit != COUNTS:
        if unit not in units:
            raise ValueError(f"unknown unit {unit!r}; {nearest(unit, (*units, COUNTS))}")
        if sensitivity is not None:
            raise ValueError(f"{key} applies only to unit = {COUNTS!r}, but unit is {unit!r}: remove it")
        return units[unit]
    if sensitivity is None:
        raise ValueError(f"unit {COUNTS!r} needs {key}: give the value of the sensor's data sheet")
    if not 0 < sensitivity < 1e6:
        raise ValueError(
            f"{key} is {sensitivity:g}: give the value of one count, above 0, as in the sensor's data sheet"
        )
    return sensitivity
