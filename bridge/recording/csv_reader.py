"""CSV as the columns of a recording, in SI units; the unit is in each column's name.

A header row, one row a sample:
    t_s | t_ms | t_us                                       time of the sample
    gyro_x_rad_s ... gyro_z_rad_s | gyro_x_dps ... | gyro_x_mdps ...      also gx_dps and so on
    accel_x_m_s2 ... accel_z_m_s2 | accel_x_g ... | accel_x_mg ...        also ax_g and so on
    temperature_c, rate_hz
What is in other columns is passed over, be it numbers or not.
"""

import csv
import difflib
import logging
import re
from array import array
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from bridge.os_words import why
from bridge.recording.error import RecordingError
from bridge.recording.recording import Floats
from bridge.recording.table import Table
from bridge.wording import count

_log = logging.getLogger(__name__)

_G = 9.80665
_DEGREE = float(np.pi / 180)
_GYRO = {"rad_s": 1.0, "dps": _DEGREE, "mdps": _DEGREE * 1e-3}
_ACCEL = {"m_s2": 1.0, "g": _G, "mg": _G * 1e-3}
_TIME = {"t_s": 1.0, "t_ms": 1e-3, "t_us": 1e-6}
#: of the largest value: more than rounding to what people print
_AGREED = 1e-3
_VECTORS = {"gyro_rad_s": ("gyro_", "g", _GYRO), "accel_m_s2": ("accel_", "a", _ACCEL)}


def _axes(long: str, short: str, units: dict[str, float]) -> dict[tuple[str, ...], float]:
    """The names that the three columns of a vector may have, with the factor from their unit to SI."""
    return {
        tuple(f"{prefix}{axis}_{unit}" for axis in "xyz"): scale
        for unit, scale in units.items()
        for prefix in (long, short)
    }


#: the names of all columns that are read; what is in others need be no number
_USED = frozenset(chain(_TIME, ("rate_hz", "temperature_c"), *chain(*(_axes(*vector) for vector in _VECTORS.values()))))


def read_csv(path: Path) -> Table:
    """Read the columns of a recording. Raises RecordingError."""
    names, at, lines = _numbers(path)
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

    def place(column: str, sample: int, axis: int) -> tuple[str, str]:
        return repr(made_of[column][axis if len(made_of[column]) > 1 else 0]), f" in line {lines[sample]}"

    return Table(columns, place)


def _numbers(path: Path) -> tuple[list[str], dict[str, Floats], Sequence[int]]:
    """Names in the header, the columns used by name, and the line number of each sample."""
    numbers, lines = array("d"), array("L")
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file, skipinitialspace=True)
            rows = (row for row in reader if row)
            names = _names(path, next(rows, []))
            used = [i for i, name in enumerate(names) if name in _USED]
            if not any(all(axis in names for axis in axes) for axes in _axes(*_VECTORS["gyro_rad_s"])):
                raise RecordingError(f"{path}: {_no_gyro(names)}")
            for row in rows:
                line = reader.line_num
                if len(row) != len(names):
                    commas = "; are there commas in its numbers?" if len(row) > len(names) else ""
                    raise RecordingError(
                        f"{path}: line {line} has {count(len(row), 'column')}; the header has {len(names)}{commas}"
                    )
                lines.append(line)
                try:
                    numbers.extend([float(row[i]) for i in used])
                except ValueError as error:
                    raise RecordingError(
                        f"{path}: line {line}: {error}; numbers are expected under {', '.join(names[i] for i in used)}"
                    ) from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {why(error)}") from None
    except UnicodeDecodeError:
        raise RecordingError(f"{path}: not text in UTF-8; a CSV with a header row is expected") from None
    except csv.Error as error:
        raise RecordingError(f"{path}: not a CSV with a header row: {error}") from None
    table = np.frombuffer(numbers, np.float64).reshape(-1, len(used))
    return names, {names[i]: table[:, at] for at, i in enumerate(used)}, lines


def _names(path: Path, header: list[str]) -> list[str]:
    if not header:
        raise RecordingError(
            f"{path}: it is empty; a header row that names the columns, and a row a sample, are needed"
        )
    if len(header) == 1 and (between := next((mark for mark in ";\t" if mark in header[0]), "")):
        raise RecordingError(f"{path}: its columns are {between!r} apart; commas are expected, and points in numbers")
    names = [name.strip().lower() for name in header]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise RecordingError(f"{path}: the header has {', '.join(map(repr, sorted(twice)))} more than once")
    return names


def _vectors(at: dict[str, Floats], long: str, short: str, units: dict[str, float]) -> dict[tuple[str, ...], Floats]:
    """The vector (n, 3) in SI, once for each unit the file has it in, by column names."""
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
    """Column names and values; RecordingError where two units of the same quantity disagree."""
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
