"""Units of rates, accelerations and times: spellings that people use, and factors to rad/s, m/s² and s."""

import re
from collections.abc import Mapping
from math import pi
from typing import Final

#: m/s²
STANDARD_GRAVITY: Final = 9.80665
#: factors to rad/s, by unit
GYRO = {"rad/s": 1.0, "deg/s": pi / 180, "mdeg/s": pi / 180e3, "mrad/s": 1e-3, "deg/h": pi / 180 / 3600}
#: factors to m/s², by unit
ACCEL = {"m/s2": 1.0, "g": STANDARD_GRAVITY, "mg": STANDARD_GRAVITY * 1e-3, "mm/s2": 1e-3, "cm/s2": 1e-2}
#: factors to seconds, by unit of a device's clock; written exactly so
TICKS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
#: factors to seconds, by unit of a column of times
TIME = {**TICKS, "min": 60.0}

_SPELT = (
    (re.compile("[°º˚]"), "deg"),
    (re.compile("²"), "2"),
    (re.compile("[µμ]"), "u"),
    (re.compile(r"degrees?"), "deg"),
    (re.compile(r"radians?"), "rad"),
    (re.compile(r"milli-?(?=deg|g)"), "m"),
    (re.compile(r"milliseconds?|millis|msecs?"), "ms"),
    (re.compile(r"microseconds?|micros|usecs?"), "us"),
    (re.compile(r"nanoseconds?|nanos|nsecs?"), "ns"),
    (re.compile(r"seconds?|secs?\b"), "s"),
    (re.compile(r"(?<![a-z])per(?![a-z])"), "/"),
    (re.compile(r"[\s_^*·.()\[\]]"), ""),
    (re.compile(r"/+"), "/"),
    (re.compile(r"[-−]1$|⁻¹$"), "!"),
    (re.compile(r"[-−]2$|⁻2$"), "!2"),
    (re.compile(r"s!"), "/s"),
    (re.compile(r"/s/s$"), "/s2"),
)
_SHORT = {
    "dps": "deg/s",
    "mdps": "mdeg/s",
    "degs": "deg/s",
    "degsec": "deg/s",
    "deg/sec": "deg/s",
    "rads": "rad/s",
    "rad/sec": "rad/s",
    "mps2": "m/s2",
    "ms2": "m/s2",
    "gs": "g",
    "gn": "g",
    "sec": "s",
    "hr": "h",
}


def spelling(text: str) -> str:
    """Return the standard spelling of a unit; `°/s`, `deg_s` and `dps` all give deg/s.

    An unknown unit is returned in lower case, without blanks and brackets.
    """
    text = text.strip().lower()
    for pattern, put in _SPELT:
        text = pattern.sub(put, text)
    return _SHORT.get(text, text)


def unit_in(text: str, known: Mapping[str, float]) -> float | None:
    """Return the factor from a unit to SI; None if the unit is not in `known`.

    text: the unit, in any spelling. known: factors to SI by standard spelling: GYRO, ACCEL, TICKS or TIME.
    """
    return known.get(spelling(text))
