"""Recognition of column names in many spellings: quantity, axis and unit.

`Gyroscope X (deg/s)`, `gyroX`, `w_RS_S_x [rad s^-1]`, `gx_dps` and `Angular velocity.y` are all rates about an axis.
"""

import re
from typing import NamedTuple

from bridge.text.units import ACCEL, GYRO, TIME, spelling

_BRACKETS = re.compile(r"[(\[{]([^)\]}]*)[)\]}]")
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_AXIS = re.compile(r"(gyroscope|gyro|gyr|accelerometer|acceleration|accel|acc|omega|angvel|[gaw])[_-]?([xyz])")
_GYRO = {"gyr", "gyro", "gyros", "gyroscope", "gyroscopes", "omega", "angvel", "rotationrate", "angularvelocity"}
_ACCEL = {"acc", "accel", "accl", "accels", "accelerometer", "accelerometers", "acceleration", "accelerations"}
_PAIRS = (
    {"angular", "rate"},
    {"angular", "velocity"},
    {"angular", "vel"},
    {"angular", "speed"},
    {"ang", "vel"},
    {"ang", "rate"},
    {"rotation", "rate"},
    {"rate", "turn"},
)
#: words of quantities that are not measured rates or accelerations, though their units or other words are alike
_OTHER = {
    *("mag", "magn", "magnetometer", "magnetic", "angle", "angles", "euler", "quat", "quaternion", "orientation"),
    *("bias", "std", "stdev", "sigma", "var", "cov", "covariance", "offset", "offsets", "error", "err"),
    *("user", "linear", "lin", "free", "gravity", "grav", "delta", "position", "pos", "filtered", "dir", "direction"),
}
_TIME = {
    *("t", "ts", "tow", "gpst", "epoch", "elapsed", "clock", "stamp", "utc", "date"),
    *("seconds", "millis", "micros", "nanos", "ms", "us", "ns"),
}
_COUNTER = {"counter", "packetcounter", "packet", "sample", "samples", "index", "frame", "seq", "sequence", "n"}
_OWN_CLOCK = {"sensor", "chip", "chiptime", "device", "micros", "millis", "us", "sampletime", "elapsed"}
_ARRIVAL = {"phone", "host", "arrival", "received", "pc", "system", "rtc", "date"}


class Name(NamedTuple):
    """Meaning of a column's name: quantity, axis and unit.

    kind: gyro, accel, axis, time, counter, temperature or rate; empty for none of these. axis: x, y, z or empty.
    unit: standard spelling; empty if not stated. group: the other words of the name, which the three axes of one sensor
    share. rank: preference of a time column; the lowest is used first.
    """

    kind: str
    axis: str
    unit: str
    group: tuple[str, ...]
    rank: int = 0


_NOTHING = Name("", "", "", ())


def understood(name: str) -> Name:
    """Return the meaning of one column's name, such as `Gyroscope X (deg/s)`; `kind` is empty if it is not recognised."""
    bare, unit = _unit_of(name.strip())
    words = [word.lower() for word in _WORD.findall(bare)]
    if not words:
        return _NOTHING
    if name.strip().lower() in {"rate_hz", "output_hz", "sample_rate_hz"}:
        return Name("rate", "", "hz", ())
    if words[0].startswith("temp") or "temperature" in words or unit in {"degc", "c", "celsius"}:
        return Name("temperature", "", unit, tuple(words))
    if words == ["t"] and unit and unit not in TIME:
        return Name("temperature", "", unit, ("t",)) if unit == "deg" else _NOTHING
    axis, words = _axis_of(words)
    others = set(words)
    if axis:
        return _of_axis(axis, unit, words, others)
    if unit in TIME or others & _TIME or any(word.startswith("time") or word.endswith("time") for word in words):
        return _time(unit, words, others)
    if others & _COUNTER and not unit:
        return Name("counter", "", "", tuple(words))
    return _NOTHING


def _of_axis(axis: str, unit: str, words: list[str], others: set[str]) -> Name:
    if others & _OTHER:
        return _NOTHING
    if unit in TIME:
        return _time(unit, words, others)
    rest = tuple(words)
    if others & _GYRO and others & _ACCEL:  # a sensor's name before the quantity's: the last word decides
        others -= _GYRO if [word for word in words if word in _GYRO | _ACCEL][-1] in _ACCEL else _ACCEL
    if others & _GYRO or any(pair <= others for pair in _PAIRS) or words[:1] == ["w"]:
        return Name("gyro", axis, unit, rest)
    if others & _ACCEL or words[:1] == ["a"] or {"specific", "force"} <= others:
        return Name("accel", axis, unit, rest)
    if words[:1] == ["g"] or (words == ["g"]):
        return Name("gyro", axis, unit, rest)
    if unit in GYRO or unit in ACCEL or (not rest and not unit):
        return Name("axis", axis, unit, rest)
    return _NOTHING


def _time(unit: str, words: list[str], others: set[str]) -> Name:
    if unit not in TIME:
        unit = next((spelling(word) for word in words if spelling(word) in TIME and word not in {"s", "min"}), "")
    rank = 2 - 2 * bool(others & _OWN_CLOCK) + 2 * bool(others & _ARRIVAL)
    rank += bool(others & _ACCEL) - bool(others & _GYRO)
    return Name("time", "", unit, tuple(words), rank)


def _unit_of(name: str) -> tuple[str, str]:
    """Return the name without its unit, and the unit: in brackets, else its last words."""
    if found := _BRACKETS.findall(name):
        unit = next(
            (spelling(one) for one in reversed(found) if spelling(one) in {*GYRO, *ACCEL, *TIME, "degc", "c"}), ""
        )
        return _BRACKETS.sub(" ", name), unit or spelling(found[-1])
    parts = re.split(r"[_\s,]+", name)
    for last in (3, 2, 1):
        unit = spelling("_".join(parts[-last:])) if last == 1 else spelling("/".join(parts[-last:]))
        if (
            len(parts) > last
            and unit in {*GYRO, *ACCEL, *TIME, "degc"}
            and not (last == 1 and parts[-1].lower() == "c")
        ):
            return "_".join(parts[:-last]), unit
    return name, "degc" if name.lower().endswith(("degc", "_c")) else ""


def _axis_of(words: list[str]) -> tuple[str, list[str]]:
    """Return the axis, and the words without it."""
    for at, word in enumerate(words):
        if word in {"x", "y", "z"}:
            left = [*words[:at], *words[at + 1 :]]
            return word, [one for one in left if one not in {"axis", "ax"} or (one == "ax" and len(left) == 1)]
    for at, word in enumerate(words):
        if match := _AXIS.fullmatch(word):
            return match[2], [*words[:at], match[1], *words[at + 1 :]]
    return "", words
