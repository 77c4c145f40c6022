"""CSV into the named columns of a recording, in SI units; the unit is in each column's name."""

import csv
import difflib
from array import array
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.os_words import why
from bridge.recording_error import RecordingError
from bridge.wording import count

Floats = NDArray[np.float64]

_G = 9.80665
_DEGREE = float(np.pi / 180)
_GYRO = {"rad_s": 1.0, "dps": _DEGREE, "mdps": _DEGREE * 1e-3}
_ACCEL = {"m_s2": 1.0, "g": _G, "mg": _G * 1e-3}
_TIME = {"t_s": 1.0, "t_ms": 1e-3, "t_us": 1e-6}
_VECTORS = {"gyro_rad_s": ("gyro_", "g", _GYRO), "accel_m_s2": ("accel_", "a", _ACCEL)}


def read_csv(path: Path) -> dict[str, Floats]:
    """The columns gyro_rad_s (n, 3), and where there are accel_m_s2 (n, 3), temperature_c (n,), t_s (n,)."""
    names, table = _table(path)
    at = {name: table[:, i] for i, name in enumerate(names)}
    columns = {}
    for column, (long, short, units) in _VECTORS.items():
        found = _vector(at, long, short, units)
        if found is not None:
            columns[column] = found
    if "gyro_rad_s" not in columns:
        raise RecordingError(f"{path}: {_no_gyro(names)}")
    for name, scale in _TIME.items():
        if name in at:
            columns["t_s"] = at[name] * scale
    if "temperature_c" in at:
        columns["temperature_c"] = at["temperature_c"].copy()
    return columns


def _table(path: Path) -> tuple[list[str], Floats]:
    """The names in the header, and a row of numbers for each of the file's; only numbers are kept, a file may be long."""
    numbers = array("d")
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = (row for row in csv.reader(file, skipinitialspace=True) if row)
            names = _names(path, next(rows, []))
            for number, row in enumerate(rows, 1):
                if len(row) != len(names):
                    raise RecordingError(
                        f"{path}: row {number} has {count(len(row), 'column')}; the header has {len(names)}"
                    )
                try:
                    numbers.extend(map(float, row))
                except ValueError:
                    raise _bad_number(path, names, number, row) from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {why(error)}") from None
    except UnicodeDecodeError:
        raise RecordingError(f"{path}: not text in UTF-8; a CSV with a header row is expected") from None
    except csv.Error as error:
        raise RecordingError(f"{path}: not a CSV with a header row: {error}") from None
    return names, np.frombuffer(numbers, np.float64).reshape(-1, len(names))


def _names(path: Path, header: list[str]) -> list[str]:
    if not header:
        raise RecordingError(
            f"{path}: it is empty; a header row that names the columns, and a row a sample, are needed"
        )
    names = [name.strip().lower() for name in header]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise RecordingError(f"{path}: the header has {', '.join(sorted(twice))} more than once")
    return names


def _vector(at: dict[str, Floats], long: str, short: str, units: dict[str, float]) -> Floats | None:
    for unit, scale in units.items():
        for prefix in (long, short):
            axes = [f"{prefix}{axis}_{unit}" for axis in "xyz"]
            if all(name in at for name in axes):
                with np.errstate(over="ignore"):  # what becomes infinite is refused with its sample
                    return np.stack([at[name] for name in axes], axis=1) * scale
    return None


def _no_gyro(names: list[str]) -> str:
    wanted = [f"{prefix}{axis}_{unit}" for unit in _GYRO for prefix in ("gyro_", "g") for axis in "xyz"]
    missing = "the columns gyro_x_rad_s, gyro_y_rad_s, gyro_z_rad_s (or gx_dps, gy_dps, gz_dps) are needed"
    hints = [
        f"{name!r}: did you mean {close[0]!r}?"
        for name in names
        if name not in wanted and (close := difflib.get_close_matches(name, wanted, n=1, cutoff=0.6))
    ]
    return f"{missing}; the header has {', '.join(names)}. {' '.join(hints[:3])}".strip()


def _bad_number(path: Path, names: list[str], number: int, row: list[str]) -> RecordingError:
    for name, value in zip(names, row, strict=True):
        try:
            float(value)
        except ValueError:
            return RecordingError(f"{path}: row {number}, column {name!r}: {value[:32]!r} is not a number")
    return RecordingError(f"{path}: row {number} is not of numbers")
