"""Drops rows with missing or impossible rates, and fills gaps in the other columns."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.recording.error import RecordingError
from bridge.recording.recording import Floats
from bridge.terminal.plurals import count
from bridge.wire.codec import MAX_ACCEL, MAX_CELSIUS, MAX_RATE

_MAX_TIME_S = 1e10  # largest time since any epoch: 300 years
_MOST_BAD = 0.2  # largest share of bad rows; more are no accident
_LIMITS = {
    "gyro_rad_s": (
        MAX_RATE,
        "rad/s",
        "if the unit is degrees per second, give --gyro-unit deg/s; if counts, give --gyro-sensitivity",
    ),
    "accel_m_s2": (MAX_ACCEL, "m/s²", "if the unit is mg, give --accel-unit mg; if counts, give --accel-sensitivity"),
    "temperature_c": (MAX_CELSIUS, "°C", "the values may be counts"),
    "t_s": (_MAX_TIME_S, "s", "if the unit is another, give --time-unit us or ns"),
}
#: arguments: column, sample, axis; results: the file's name of that column or axis, and the sample's place in the file
Place = Callable[[str, int, int], tuple[str, str]]


def in_arrays(column: str, sample: int, _axis: int) -> tuple[str, str]:
    """Return the words that name a value of a file of arrays in an error: the column, and ` at sample N`.

    It is the Place for files whose columns have no names of their own.
    """
    return repr(column), f" at sample {sample}"


def drop_bad_rows(path: Path, columns: dict[str, Floats], place: Place, notes: list[str]) -> None:
    """Drop rows whose rate is missing or impossible; interpolate gaps in acceleration and temperature.

    columns: in SI units, by name; changed in place. place: names a value in an error. notes: gets a sentence per
    repair. If rows are dropped, the column `row` keeps the old numbers of the others. Raises RecordingError if too many
    rows are bad.
    """
    gyro = columns["gyro_rad_s"]
    limit = _LIMITS["gyro_rad_s"][0]
    good = np.ones(len(gyro), bool)
    if not _within(gyro, limit):
        good = np.asarray((np.abs(gyro) <= limit).all(axis=1))
    bad = np.flatnonzero(~good)
    if len(bad) > _MOST_BAD * len(gyro):
        raise RecordingError(f"{path}: {_wrong_values('gyro_rad_s', gyro, place)}")
    for name, what in (("accel_m_s2", "the accelerometer"), ("temperature_c", "the temperature")):
        if name not in columns:
            continue
        filled = _filled(columns[name].reshape(len(gyro), -1), _LIMITS[name][0])
        if filled is None:
            notes.append(f"{what} is not used: {_wrong_values(name, columns[name], place)}")
            del columns[name]
        else:
            columns[name] = filled.reshape(columns[name].shape)
    if "t_s" in columns:
        time = columns["t_s"]
        late = ~(np.abs(time) <= _MAX_TIME_S)
        if late.any():
            if np.count_nonzero(late) > _MOST_BAD * len(time):
                raise RecordingError(f"{path}: {_wrong_values('t_s', time, place)}")
            columns["t_s"] = np.where(late, np.nan, time)
    if len(bad):
        notes.append(f"{count(len(bad), 'row')} left out: a rate is missing or impossibly large")
        columns["row"] = np.arange(len(gyro), dtype=np.float64)
        keep_rows(columns, good)


def keep_rows(columns: dict[str, Floats], rows: NDArray[np.bool_] | NDArray[np.intp]) -> None:
    """Keep the chosen rows of every column, in place. rows: mask (n,) or indices. A column () stays as it is."""
    for name, column in columns.items():
        if column.ndim:
            columns[name] = column[rows]


def _within(column: Floats, limit: float) -> bool:
    """Whether all values are finite and within ±limit."""
    return bool(max(column.max(), -column.min()) <= limit)


def _filled(column: Floats, limit: float) -> Floats | None:
    """Interpolate bad rows of a column (n, c); None if too few rows are good."""
    if _within(column, limit):
        return column
    good = np.asarray((np.abs(column) <= limit).all(axis=1))
    beyond = np.isfinite(column).all(axis=1) & ~good
    if np.count_nonzero(good) < 2 or np.count_nonzero(beyond) > _MOST_BAD * len(column) or np.mean(good) < 0.02:
        return None
    return np.stack([interpolated(axis, good) for axis in column.T], axis=1)


def interpolated(column: Floats, good: NDArray[np.bool_]) -> Floats:
    """Replace the values of a column (n,) that are not good by linear interpolation over the rows."""
    rows = np.arange(len(column))
    return np.interp(rows, rows[good], column[good])


def _wrong_values(name: str, column: Floats, place: Place) -> str:
    """Describe the first impossible value of a column, and what to do."""
    bad = np.argwhere(~np.isfinite(column))
    if len(bad):
        what, where = place(name, int(bad[0][0]), int(bad[0][-1]))
        return f"{what} is not a finite number{where} ({count(len(bad), 'such value')})"
    limit, unit, words = _LIMITS[name]
    large = np.argwhere(np.abs(column) > limit)
    what, where = place(name, int(large[0][0]), int(large[0][-1]))
    value = column[tuple(large[0])]
    return f"{what} is {value:g} {unit}{where}; at most ±{limit:g} {unit} is possible; {words}"
