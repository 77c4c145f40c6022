"""Makes a Recording from columns of samples: repairs or refuses bad rows and times, checks units, notes repairs."""

import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.recording.clock import ClockFault, mend
from bridge.recording.error import RecordingError
from bridge.recording.plausibility import (
    FASTEST_HZ,
    SLOWEST_HZ,
    believed_accel,
    check_gyro,
    check_rate,
    check_time,
    doubts_of_gyro,
    rate_of,
)
from bridge.recording.reading import Reading
from bridge.recording.recording import Floats, Recording
from bridge.recording.repeats import repeated, repeated_without_time
from bridge.terminal.plurals import count
from bridge.wire.codec import MAX_ACCEL, MAX_CELSIUS, MAX_RATE

_log = logging.getLogger(__name__)
_MAX_TIME_S = 1e10  # largest time since any epoch: 300 years
_OTHER_RATE = 0.02
_SAME_RATE = 1e-3  # relative: as precisely as people write a rate
#: largest shares of bad and of repeated rows; more are no accident
_MOST_BAD, _MOST_REPEATED = 0.2, 0.1
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
    """Name the place of a value in a file of arrays (a Place)."""
    return repr(column), f" at sample {sample}"


@dataclass(slots=True)
class Table:
    """Columns of a file.

    columns: gyro_rad_s (n, 3) and, if known, accel_m_s2 (n, 3), temperature_c (n,), t_s (n,), counter (n,), rate_hz ().

    tick_s: seconds per count of the file's time column, 0 when unknown. notes: what was understood, for the user.
    """

    columns: dict[str, Floats]
    place: Place = in_arrays
    device: str = ""
    boot: int = 0
    notes: list[str] = field(default_factory=list)
    tick_s: float = 0.0


def recording_of(path: Path, table: Table, reading: Reading) -> Recording:
    """Make a Recording from a table: rows and times repaired, units checked. Raises RecordingError."""
    columns, notes = dict(table.columns), list(table.notes)
    _check_shapes(path, columns)
    rate = _rate(path, columns, reading)
    _drop_bad_rows(path, table, columns, notes)
    time, parts = _time(path, table, columns, rate, reading, notes)
    chosen = _part(path, time, parts, reading)
    time = time[chosen] - time[chosen][0]
    gyro = columns["gyro_rad_s"][chosen]
    accel = columns.get("accel_m_s2")
    warm = columns.get("temperature_c")
    measured_hz = rate_of(time)
    check_gyro(path, gyro, measured_hz)
    notes += doubts_of_gyro(gyro, measured_hz)
    accel, said = believed_accel(None if accel is None else accel[chosen])
    notes += [said] if said else []
    for words in notes:
        _log.warning("%s: %s", path, words)
    return Recording(
        time_s=time,
        gyro=gyro,
        accel=accel,
        temperature_c=None if warm is None else warm[chosen],
        rate_hz=rate or measured_hz,
        name=path.stem,
        device=table.device,
        boot=table.boot,
        notes=tuple(notes),
    )


def _check_shapes(path: Path, columns: dict[str, Floats]) -> None:
    gyro = columns["gyro_rad_s"]
    if gyro.ndim != 2 or gyro.shape[1] != 3:
        raise RecordingError(f"{path}: 'gyro_rad_s' has shape {gyro.shape}: give (n, 3), one row per sample")
    n = len(gyro)
    shapes = {
        "gyro_rad_s": (n, 3),
        "accel_m_s2": (n, 3),
        "temperature_c": (n,),
        "t_s": (n,),
        "counter": (n,),
        "rate_hz": (),
    }
    for name, column in columns.items():
        if column.shape != shapes[name]:
            raise RecordingError(
                f"{path}: {name!r} has shape {column.shape}: give {shapes[name]}, because 'gyro_rad_s' has {count(n, 'sample')}"
            )
    if n < 2:
        raise RecordingError(f"{path}: {count(n, 'sample')}; at least 2 are needed")


def _rate(path: Path, columns: dict[str, Floats], reading: Reading) -> float | None:
    own = float(columns["rate_hz"]) if "rate_hz" in columns else None
    if own is not None and not np.isfinite(own):
        raise RecordingError(f"{path}: 'rate_hz' is not a finite number: give the rate with --rate-hz")
    for said in (own, reading.rate_hz):
        if said is not None and not SLOWEST_HZ <= said <= FASTEST_HZ:
            raise RecordingError(
                f"{path}: the given rate is {said:g} Hz: give --rate-hz from {SLOWEST_HZ:g} to {FASTEST_HZ:g}"
            )
    if own is not None and reading.rate_hz is not None and abs(reading.rate_hz - own) > _SAME_RATE * own:
        _log.warning("%s: the file states %.5g Hz; the given %.5g Hz is used", path, own, reading.rate_hz)
    return reading.rate_hz or own


def _drop_bad_rows(path: Path, table: Table, columns: dict[str, Floats], notes: list[str]) -> None:
    """Drop rows whose rate is missing or impossible; interpolate gaps in acceleration and temperature."""
    gyro = columns["gyro_rad_s"]
    limit = _LIMITS["gyro_rad_s"][0]
    good = np.ones(len(gyro), bool)
    if not _within(gyro, limit):
        good = np.asarray((np.abs(gyro) <= limit).all(axis=1))
    bad = np.flatnonzero(~good)
    if len(bad) > _MOST_BAD * len(gyro):
        raise RecordingError(f"{path}: {_wrong_values('gyro_rad_s', gyro, table.place)}")
    for name, what in (("accel_m_s2", "the accelerometer"), ("temperature_c", "the temperature")):
        if name not in columns:
            continue
        filled = _filled(columns[name].reshape(len(gyro), -1), _LIMITS[name][0])
        if filled is None:
            notes.append(f"{what} is not used: {_wrong_values(name, columns[name], table.place)}")
            del columns[name]
        else:
            columns[name] = filled.reshape(columns[name].shape)
    if "t_s" in columns:
        time = columns["t_s"]
        late = ~(np.abs(time) <= _MAX_TIME_S)
        if late.any():
            if np.count_nonzero(late) > _MOST_BAD * len(time):
                raise RecordingError(f"{path}: {_wrong_values('t_s', time, table.place)}")
            columns["t_s"] = np.where(late, np.nan, time)
    if len(bad):
        notes.append(f"{count(len(bad), 'row')} left out: a rate is missing or impossibly large")
        columns["row"] = np.arange(len(gyro), dtype=np.float64)
        _keep(columns, good)


def _keep(columns: dict[str, Floats], rows: NDArray[np.bool_] | NDArray[np.intp]) -> None:
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
    good = (np.abs(column) <= limit).all(axis=1)
    beyond = np.isfinite(column).all(axis=1) & ~good
    if np.count_nonzero(good) < 2 or np.count_nonzero(beyond) > _MOST_BAD * len(column) or np.mean(good) < 0.02:
        return None
    rows = np.arange(len(column))
    return np.stack([np.interp(rows, rows[good], column[good, axis]) for axis in range(column.shape[1])], axis=1)


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


def _values(columns: dict[str, Floats]) -> Floats:
    accel = columns.get("accel_m_s2")
    return columns["gyro_rad_s"] if accel is None else np.hstack([columns["gyro_rad_s"], accel])


def _time(
    path: Path, table: Table, columns: dict[str, Floats], rate: float | None, reading: Reading, notes: list[str]
) -> tuple[Floats, list[int]]:
    """Return the time of each kept row, and where each boot begins; sort and drop rows. Raises RecordingError."""
    if "t_s" not in columns:
        if rate is None:
            raise RecordingError(
                f"{path}: neither sample times nor 'rate_hz': give the rate with --rate-hz, or as rate_hz in a ward's file"
            )
        return _counted(path, columns, rate, notes), [0]
    rises = bool((np.diff(columns["t_s"]) > 0).all())
    if not rises and (again := repeated(columns["t_s"], _values(columns))).any():
        notes.append(f"{count(int(again.sum()), 'row')} left out: equal to an earlier row, including the time")
        _keep(columns, ~again)
    if len(columns["t_s"]) < 2:
        raise RecordingError(f"{path}: {count(len(columns['t_s']), 'different row')}; at least 2 are needed")
    try:
        mended = mend(columns["t_s"], table.tick_s)
    except ClockFault as fault:
        if reading.rate_hz is None:
            raise RecordingError(f"{path}: {fault}") from None
        notes.append(f"the times are replaced by the given rate, {reading.rate_hz:g} Hz: {fault}")
        return _counted(path, columns, reading.rate_hz, notes), [0]
    if not rises:
        _keep(columns, mended.order)
    notes += mended.notes
    time = mended.time
    if reading.rate_hz is not None:
        return _at_told_rate(time, mended.starts, reading.rate_hz, notes, arrival=mended.arrival), mended.starts
    for start, end in zip(mended.starts, [*mended.starts[1:], len(time)], strict=True):
        check_time(path, time[start:end])
        if rate is not None:
            check_rate(path, time[start:end], rate)
            own = rate_of(time[start:end])
            if abs(own / rate - 1) > _OTHER_RATE:
                notes.append(f"the file states {rate:g} Hz, its times give {own:.4g} Hz: the times are used")
    return time, mended.starts


def _counted(path: Path, columns: dict[str, Floats], rate: float, notes: list[str]) -> Floats:
    """Return times from a sample counter if there is a usable one, else from row numbers."""
    counter = columns.pop("counter", None)
    counts = counter is not None and len(np.unique(counter)) > len(counter) / 2
    again = (
        repeated(counter, _values(columns))
        if counts and counter is not None
        else repeated_without_time(_values(columns))
    )
    share = float(np.mean(again))
    if share > _MOST_REPEATED:
        raise RecordingError(
            f"{path}: {share:.0%} of the rows repeat an earlier row, and without times repeats cannot be told from new samples: "
            "export the file with times"
        )
    if again.any():
        notes.append(f"{count(int(again.sum()), 'row')} left out: equal to an earlier row in all values")
    number = columns.pop("row", None)
    rows = np.arange(len(again), dtype=np.float64) if number is None else number
    rows = rows - np.cumsum(again)
    if again.any():
        rows = rows[~again]
        counter = None if counter is None else counter[~again]
        _keep(columns, ~again)
    if counter is not None and (by_counter := _numbers(counter)) is not None:
        if (missing := int(by_counter[-1]) + 1 - len(by_counter)) and int(by_counter[-1]) != int(rows[-1] - rows[0]):
            notes.append(f"{count(missing, 'sample')} missing, by the counter")
        rows = by_counter
    return np.asarray((rows - rows[0]) / rate)


def _numbers(counter: Floats) -> Floats | None:
    """Return sample numbers of a counter, wraps undone; None if it does not count samples one by one."""
    if not np.isfinite(counter).all() or (counter != np.rint(counter)).any() or len(counter) < 8:
        return None
    steps = np.diff(counter)
    one = float(np.median(steps))  # packets of other kinds may be counted, too
    if not 1 <= one <= 16:
        return None
    back = steps < 0
    if back.any():
        most = max((1 << bits for bits in (8, 16, 24, 32)), key=lambda m: -abs(m - (counter.max() + 1)))
        steps = np.where(back, steps + most, steps)
    steps = steps / one
    if (steps < 1).any() or steps.max() > 1000 or (steps != np.rint(steps)).any():
        return None
    return np.concatenate([[0.0], np.cumsum(steps)])


def _at_told_rate(time: Floats, starts: list[int], rate_hz: float, notes: list[str], *, arrival: bool) -> Floats:
    """Return times at the rate given by the user; gaps in the file's own times stay gaps."""
    told = np.empty(len(time))
    for start, end in zip(starts, [*starts[1:], len(time)], strict=True):
        steps = np.diff(time[start:end]) * rate_of(time[start:end]) if end - start > 1 else np.empty(0)
        whole = np.ones(len(steps)) if arrival else np.where(steps > 1.75, np.rint(steps), 1.0)
        told[start:end] = np.concatenate([[0.0], np.cumsum(whole)]) / rate_hz
    own = rate_of(time[: starts[1]] if len(starts) > 1 else time)
    doubt = f", far from the {own:.4g} Hz of its times" if abs(own / rate_hz - 1) > 0.1 else ""
    notes.append(f"the times are replaced by the given rate, {rate_hz:g} Hz{doubt}")
    return told


def _part(path: Path, time: Floats, starts: list[int], reading: Reading) -> slice:
    """Return the rows of the chosen boot. Raises RecordingError."""
    ends = [*starts[1:], len(time)]
    boot = reading.boot
    if boot is None and len(starts) > 1:
        said = ", ".join(
            f"{number} ({count(end - start, 'sample')}, {time[end - 1] - time[start]:.0f} s)"
            for number, (start, end) in enumerate(zip(starts, ends, strict=True), 1)
        )
        raise RecordingError(
            f"{path}: the device rebooted (its time restarted {count(len(starts) - 1, 'time')}); choose with --boot: {said}"
        )
    if boot is not None and not 1 <= boot <= len(starts):
        raise RecordingError(f"{path}: --boot is {boot}, but the file has boots 1 to {len(starts)}")
    at = 0 if boot is None else boot - 1
    if ends[at] - starts[at] < 2:
        raise RecordingError(f"{path}: {count(ends[at] - starts[at], 'sample')}; at least 2 are needed")
    return slice(starts[at], ends[at])
