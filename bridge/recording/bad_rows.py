"""Repair of bad rows: drops rows with missing or impossible rates, fills gaps in other columns, finds repeated rows."""

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
#: lags at which rows are compared, to estimate how often two are equal by chance
_LAGS = (5, 7, 11, 13)
#: repeats are believed only if chance explains less than this share of them
_BY_CHANCE = 0.05
Flags = NDArray[np.bool_]
#: arguments: column, sample, axis; results: the file's name of that column or axis, and the sample's place in the file
Place = Callable[[str, int, int], tuple[str, str]]


def in_arrays(column: str, sample: int, _axis: int) -> tuple[str, str]:
    """Return the position of a value, for an error: the quoted name of its column, and the text ` at sample N`.

    sample: row number, from 0. _axis: not used. A `Table` read from a file of arrays has this function as `place`.
    """
    return repr(column), f" at sample {sample}"


def drop_bad_rows(path: Path, columns: dict[str, Floats], place: Place, notes: list[str]) -> None:
    """Drop rows whose rate is missing or impossible; interpolate gaps in acceleration and temperature.

    columns: as in `Table.columns`; changed in place. The limits of plausible values are MAX_RATE (rad/s), MAX_ACCEL
    (m/s²) and MAX_CELSIUS (°C).
    An acceleration or temperature is removed if less than 2 % of its rows are good, or more than 20 % are beyond the
    limit.
    If rows are dropped, a column `row` (n,) is added: the row number, from 0, that each remaining row had before.
    place(column, row, axis): returns the name of a value in the file and the text of its position, for errors.
    notes: a sentence is added for each repair.
    Raises RecordingError if more than 20 % of the rows have bad rates or times.
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


def keep_rows(columns: dict[str, Floats], rows: Flags | NDArray[np.intp]) -> None:
    """Keep only the chosen rows of every column, in place.

    columns: arrays by name; an array without rows, of shape (), stays as it is. rows: mask (n,), or indices (m,).
    """
    for name, column in columns.items():
        if column.ndim:
            columns[name] = column[rows]


def _within(column: Floats, limit: float) -> bool:
    """Return whether all values are finite and within ±limit."""
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


def interpolated(column: Floats, good: Flags) -> Floats:
    """Return a column (n,) with its bad values linearly interpolated over the row number, in the column's unit.

    good (n,): True for each value to keep, False for each bad value.
    """
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


def repeated(time: Floats, values: Floats) -> Flags:
    """Return a mask (n,), True for each row that repeats an earlier row; first occurrences stay False.

    Rows are compared by time (n,), s or counts, and by all values (n, c).
    A row is marked if it equals the row before it. It is also marked if it belongs to a run of two or more rows that
    equals an earlier run.
    """
    return _seen_before(np.column_stack([time, values]))


def repeated_without_time(values: Floats) -> Flags:
    """Return a mask (n,), True for each row that repeats an earlier row, judged by its values (n, c) without times.

    First occurrences stay False.
    A row is marked if it equals the row before it, or belongs to a run of rows that equals an earlier run.
    Rows may also be equal by chance. The probability of that is estimated from pairs of rows 5 to 13 rows apart.
    If chance explains 5 % or more of the marked rows, only rows equal to the row before stay marked. If chance
    explains 5 % or more of these too, or there are at most 26 rows, no row is marked.
    """
    n = len(values)
    none = np.zeros(n, bool)
    if n <= 2 * max(_LAGS):
        return none
    seen = _seen_before(values)
    equal = [np.mean(np.all(values[lag:] == values[:-lag], axis=1)) for lag in _LAGS]
    by_axis = [
        np.mean([np.mean(values[lag:, axis] == values[:-lag, axis]) for lag in _LAGS])
        for axis in range(values.shape[1])
    ]
    chance = max(float(np.prod(by_axis)), float(np.median(equal)))
    if seen.any() and n * n / 2 * chance < _BY_CHANCE * np.count_nonzero(seen):
        return seen
    after = np.concatenate([[False], np.all(values[1:] == values[:-1], axis=1)])
    if after.any() and n * chance < _BY_CHANCE * np.count_nonzero(after):
        return after
    return none


def _seen_before(rows: Floats) -> Flags:
    """Flag rows (n,) that equal the row before, or belong to a run that equals an earlier run.

    A single row that equals one further back is not flagged: a clipped or faulty sensor often reads the same again.
    """
    n = len(rows)
    # Adding zero gives -0.0 the same bits as 0.0.
    bits = np.ascontiguousarray(rows + 0.0).view(np.dtype((np.void, rows.dtype.itemsize * rows.shape[1]))).ravel()
    _, group = np.unique(bits, return_inverse=True)
    order = np.argsort(group, kind="stable")
    same = group[order[1:]] == group[order[:-1]]
    last = np.full(n, -1)
    last[order[1:][same]] = order[:-1][same]
    goes_on = np.concatenate([[False], (last[1:] == last[:-1] + 1) & (last[:-1] >= 0)])
    begins = np.concatenate([goes_on[1:], [False]])
    return np.asarray((last >= 0) & ((last == np.arange(n) - 1) | goes_on | begins))
