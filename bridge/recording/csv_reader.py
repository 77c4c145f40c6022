"""CSV into the named columns of a recording, in SI units; the unit is in each column's name."""

import csv
import difflib
import logging
import re
from array import array
from collections.abc import Iterable, Iterator
from itertools import chain, islice
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.os_words import why
from bridge.recording.error import RecordingError
from bridge.wording import count

_log = logging.getLogger(__name__)
Floats = NDArray[np.float64]

_G = 9.80665
_DEGREE = float(np.pi / 180)
_GYRO = {"rad_s": 1.0, "dps": _DEGREE, "mdps": _DEGREE * 1e-3}
_ACCEL = {"m_s2": 1.0, "g": _G, "mg": _G * 1e-3}
_TIME = {"t_s": 1.0, "t_ms": 1e-3, "t_us": 1e-6}
#: of the largest value: more than rounding to what people print
_AGREED = 1e-3
_VECTORS = {"gyro_rad_s": ("gyro_", "g", _GYRO), "accel_m_s2": ("accel_", "a", _ACCEL)}


def _axes(long: str, short: str, units: dict[str, float]) -> dict[tuple[str, ...], float]:
    """The three names that a vector's columns may have, and what of SI their unit is."""
    return {
        tuple(f"{prefix}{axis}_{unit}" for axis in "xyz"): scale
        for unit, scale in units.items()
        for prefix in (long, short)
    }


#: the names of all columns that are read; what is in others need be no number
_USED = frozenset(chain(_TIME, ("rate_hz", "temperature_c"), *chain(*(_axes(*vector) for vector in _VECTORS.values()))))


class Csv(NamedTuple):
    """A file's columns gyro_rad_s (n, 3), and where there are accel_m_s2 (n, 3), temperature_c (n,), t_s (n,) or else rate_hz ().

    made_of: the names in the header, in small letters, that each of them is made of.
    """

    path: Path
    columns: dict[str, Floats]
    made_of: dict[str, tuple[str, ...]]

    def place(self, column: str, sample: int, axis: int = 0) -> tuple[str, str]:
        """What the file calls a column, or an axis of it; where in the file a sample is."""
        with self.path.open(encoding="utf-8-sig", newline="") as file:
            rows = _rows(file)
            _, header = next(rows)
            line, _ = next(islice(rows, sample, None))
        names = [name.strip() for name in header]
        return repr(names[list(map(str.lower, names)).index(self.made_of[column][axis])]), f" in line {line}"


def read_csv(path: Path) -> Csv:
    """All that is used of a file; raises RecordingError."""
    names, at = _table(path)
    columns, made_of = dict[str, Floats](), dict[str, tuple[str, ...]]()
    for column, (long, short, units) in _VECTORS.items():
        found = _vectors(at, long, short, units)
        if found:
            made_of[column], columns[column] = _agreed(path, found)
        elif alike := [name for name in names if re.match(f"({long}|{short})[xyz]", name)]:
            _log.warning("%s: %s: not used; x, y and z are needed, in a unit that is known", path, ", ".join(alike))
    times: dict[tuple[str, ...], Floats] = {
        (name,): _since_first(at[name]) * scale for name, scale in _TIME.items() if name in at
    }
    if times:
        made_of["t_s"], columns["t_s"] = _agreed(path, times)
    elif "rate_hz" in at and len(at["rate_hz"]):
        columns["rate_hz"] = _constant(path, at["rate_hz"])
    if "temperature_c" in at:
        made_of["temperature_c"], columns["temperature_c"] = ("temperature_c",), at["temperature_c"].copy()
    return Csv(path, columns, made_of)


def _rows(file: Iterable[str]) -> Iterator[tuple[int, list[str]]]:
    """The header, then a row a sample, each with the line that it ends with."""
    reader = csv.reader(file, skipinitialspace=True)
    return ((reader.line_num, row) for row in reader if row)


def _table(path: Path) -> tuple[list[str], dict[str, Floats]]:
    """The names in the header, and the columns that are used, by name; only these numbers are kept, a file may be long."""
    numbers = array("d")
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = _rows(file)
            names = _names(path, next(rows, (0, []))[1])
            used = [i for i, name in enumerate(names) if name in _USED]
            if not any(all(axis in names for axis in axes) for axes in _axes(*_VECTORS["gyro_rad_s"])):
                raise RecordingError(f"{path}: {_no_gyro(names)}")
            chosen = itemgetter(*used)
            for line, row in rows:
                if len(row) != len(names):
                    commas = "; are there commas in its numbers?" if len(row) > len(names) else ""
                    raise RecordingError(
                        f"{path}: line {line} has {count(len(row), 'column')}; the header has {len(names)}{commas}"
                    )
                try:
                    numbers.extend(map(float, chosen(row)))
                except ValueError:
                    raise _bad_number(path, names, used, line, row) from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {why(error)}") from None
    except UnicodeDecodeError:
        raise RecordingError(f"{path}: not text in UTF-8; a CSV with a header row is expected") from None
    except csv.Error as error:
        raise RecordingError(f"{path}: not a CSV with a header row: {error}") from None
    table = np.frombuffer(numbers, np.float64).reshape(-1, len(used))
    return names, {names[i]: table[:, at] for at, i in enumerate(used)}


def _names(path: Path, header: list[str]) -> list[str]:
    if not header:
        raise RecordingError(
            f"{path}: it is empty; a header row that names the columns, and a row a sample, are needed"
        )
    if len(header) == 1 and (between := next((mark for mark in ";\t" if mark in header[0]), "")):
        raise RecordingError(f"{path}: its columns are {between!r} apart; commas are expected, and points in numbers")
    if len(header) < 3:
        raise RecordingError(
            f"{path}: its first row is {','.join(header)[:60]!r}; the names of the columns are expected there, commas between"
        )
    if all(map(_is_number, header)):
        raise RecordingError(
            f"{path}: its first row is of numbers; the names of the columns are expected there, as t_s,gx_dps,gy_dps,gz_dps"
        )
    names = [name.strip().lower() for name in header]
    if "" in names:
        raise RecordingError(
            f"{path}: column {names.index('') + 1} of the header has no name; give it one, or end no row with a comma"
        )
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise RecordingError(f"{path}: the header has {', '.join(sorted(twice))} more than once")
    return names


def _vectors(at: dict[str, Floats], long: str, short: str, units: dict[str, float]) -> dict[tuple[str, ...], Floats]:
    """All that the file has of a vector (n, 3), SI, by the names of its columns."""
    found = {}
    for axes, scale in _axes(long, short, units).items():
        if all(name in at for name in axes):
            with np.errstate(over="ignore"):  # what becomes infinite is refused with its sample
                found[axes] = np.stack([at[name] for name in axes], axis=1) * scale
    return found


def _since_first(time: Floats) -> Floats:
    with np.errstate(invalid="ignore"):  # of two infinite ones, which are refused with their sample
        return np.asarray(time - time[:1])


def _agreed(path: Path, found: dict[tuple[str, ...], Floats]) -> tuple[tuple[str, ...], Floats]:
    """What is said in several units must be the same in all of them: else nobody knows which is meant. And its columns."""
    (names, value), *others = found.items()
    for (name, *_), other in others:
        most = float(np.abs(value).max(initial=0.0))
        if not np.allclose(other, value, rtol=0.0, atol=_AGREED * most, equal_nan=True):
            raise RecordingError(
                f"{path}: {names[0]!r} and {name!r} are not the same in two units; leave one of them out"
            )
    return names, value


def _constant(path: Path, rate_hz: Floats) -> Floats:
    if np.ptp(rate_hz) != 0:
        raise RecordingError(
            f"{path}: 'rate_hz' is not the same in all rows; give the times of the samples in its place"
        )
    return np.asarray(rate_hz[0])


def _no_gyro(names: list[str]) -> str:
    wanted = list(chain(*_axes(*_VECTORS["gyro_rad_s"])))
    missing = (
        "the columns gyro_x_rad_s, gyro_y_rad_s, gyro_z_rad_s (or gx_dps, gy_dps, gz_dps: with the unit) are needed"
    )
    hints = [
        f"{name!r}: did you mean {close[0]!r}?"
        for name in names
        if name not in wanted and (close := difflib.get_close_matches(name, wanted, n=1, cutoff=0.6))
    ]
    return f"{missing}; the header has {', '.join(names)}. {' '.join(hints[:3])}".strip()


def _bad_number(path: Path, names: list[str], used: list[int], line: int, row: list[str]) -> RecordingError:
    for i in used:
        if not _is_number(row[i]):
            return RecordingError(f"{path}: line {line}, column {names[i]!r}: {row[i][:32]!r} is not a number")
    return RecordingError(f"{path}: line {line} is not of numbers")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
