"""Reader of text tables, which returns the columns of a recording in SI units."""

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import numpy as np

from bridge.recording.error import RecordingError
from bridge.recording.reading import Reading
from bridge.recording.recording import Floats
from bridge.recording.table import Table
from bridge.recording.text.columns import Clock, Columns, Triple, find, shown
from bridge.recording.text.interleaved import tags_of
from bridge.recording.text.layout import Layout, layout_of, split
from bridge.recording.text.rows import Read, read_rows
from bridge.recording.text.source import blocks
from bridge.terminal.plurals import count
from bridge.text.units import ACCEL, STANDARD_GRAVITY, TIME

#: tolerance between two units of the same quantity, of the largest value: above the rounding that people print
_AGREED = 1e-3
#: rates of an IMU: at most one unit of time puts a step within them
_SLOW_HZ, _FAST_HZ = 4.5, 4000.0
_NEAR_GRAVITY = 0.15
#: _EVEN: tolerance of an even step, of the median step; _EVENLY: share of even steps of a device's own clock
_EVEN, _EVENLY = 0.5, 0.8
#: time column of an exported recording, and its other times
_OWN_TIMES = "t_s", ["host_time_ns"]
#: two time columns whose steps differ by a larger factor are not one clock in two units
_SAME_STEP = 1.1


def read(path: Path, reading: Reading, layout: Layout | None = None) -> Table:
    """Read a recording from a text table as a Table, in SI units.

    layout: layout of the table if another file describes it; None recognises the layout.
    Raises RecordingError if the columns, units or times cannot be determined. The message names the options that
    supply them.
    """
    tags = tags_of(next(blocks(path), [])) if layout is None else None
    if tags is None:
        return _read(path, blocks(path), reading, layout)
    table = _read(path, tags.rows_of(tags.gyro, blocks(path)), reading, tag=tags.gyro)
    if reading.accel_file is None and tags.accel and "accel_m_s2" not in table.columns:
        accel = _read(path, tags.rows_of(tags.accel, blocks(path)), reading, only_accel=True, tag=tags.accel)
        _join(path, table, path, accel)
    return table


def read_columns(
    path: Path, names: list[str], numbers: Floats, reading: Reading, *, rate_hz: float = 0.0, sensor: str = ""
) -> Table:
    """Make a Table in SI units from numbers (n, c) and the names of their c columns.

    Names are recognised as those of a text table. rate_hz: rate that the file states, else 0. sensor: text that names
    the sensor, such as `gyro`, for columns named only x, y and z.
    Raises RecordingError if the columns of the rates are missing or ambiguous.
    """
    layout = Layout(None, ".", names, len(names), 0, rate_hz)
    columns = find(path, layout, reading, ["0"] * len(names), tag=sensor)
    read = Read(columns.numbers, numbers[:, columns.numbers], lines=[range(1, len(numbers) + 1)])
    return _table(path, reading, layout, columns, read)


def join_accel(path: Path, table: Table, reading: Reading) -> None:
    """Add the acceleration from the text file `reading.accel_file` to the table, in place.

    Does nothing without that option. If both files have times, the acceleration is interpolated at the times of the
    rates.
    Raises RecordingError if the file has no accelerometer or does not fit the table.
    """
    if reading.accel_file is not None:
        other = Path(reading.accel_file)
        _join(path, table, other, _read(other, blocks(other), reading, only_accel=True))


def _read(
    path: Path,
    source: Iterator[list[str]],
    reading: Reading,
    layout: Layout | None = None,
    *,
    only_accel: bool = False,
    tag: str = "",
) -> Table:
    start = next(source, [])
    if not any(line.strip() for line in start):
        raise RecordingError(f"{path}: the file is empty: give a header row with column names, then one row per sample")
    layout = layout or layout_of(start)
    if layout is None:
        raise RecordingError(
            f"{path}: no rows of numbers; the file begins with {start[0][:60]!r}. Give a header row with column names, "
            "then one row per sample"
        )
    cells = [*split(start[layout.first], layout.separator), *[""] * layout.width][: layout.width]
    columns = find(path, layout, reading, cells, only_accel=only_accel, tag=tag)
    texts = [clock.at for clock in columns.clocks if clock.text]
    read = read_rows(path, chain([start], source), layout, columns.numbers, texts)
    return _table(path, reading, layout, columns, read)


def _table(path: Path, reading: Reading, layout: Layout, columns: Columns, read: Read) -> Table:
    found: dict[str, Floats] = {}
    notes = [*columns.notes, *(f"{count(n, 'line')} left out: {what}" for what, n in read.odd.items())]
    if columns.unused:
        notes.append(f"{shown(columns.unused)}: not used: a sensor needs its x, y and z columns")
    if columns.gyro:
        found["gyro_rad_s"] = _agreed(path, layout, columns.gyro, read)
    if columns.accel:
        accel = _agreed(path, layout, columns.accel, read)
        factor, said = _by_gravity(layout, columns.accel[0], accel)
        notes += [said] if said else []
        if factor is not None:
            found["accel_m_s2"] = accel if factor == 1.0 else accel * factor
    tick_s = 0.0
    if clocks := [(clock, read.times(clock)) for clock in columns.clocks]:
        found["t_s"], tick_s, said = _best_clock(path, layout, clocks)
        notes += [said] if said else []
    elif columns.counter is not None:
        found["counter"] = read.column(columns.counter)
    if columns.temperature is not None and np.isfinite(warm := read.column(columns.temperature)).any():
        found["temperature_c"] = warm
    if rate := _rate(path, reading, layout, columns, read):
        found["rate_hz"] = np.asarray(rate)
    names = {"gyro_rad_s": columns.gyro, "accel_m_s2": columns.accel}

    def place(column: str, sample: int, axis: int) -> tuple[str, str]:
        triples = names.get(column)
        name = layout.names[triples[0].at[axis]] if triples else {"t_s": "time"}.get(column, column)
        return repr(name), f" in line {read.line(sample)}"

    return Table(found, place, notes=notes, tick_s=tick_s)


def _rate(path: Path, reading: Reading, layout: Layout, columns: Columns, read: Read) -> float:
    """Return the rate that the file states: in a column, else above its header; 0 if it states none."""
    if columns.rate is None or not len(read.numbers):
        return layout.rate_hz
    rates = read.column(columns.rate)
    if np.ptp(rates) == 0:
        return float(rates[0])
    if columns.clocks or reading.rate_hz is not None:
        return 0.0
    raise RecordingError(
        f"{path}: {layout.names[columns.rate]!r} differs between rows; give the rate with --rate-hz HZ"
    )


def _agreed(path: Path, layout: Layout, triples: list[Triple], read: Read) -> Floats:
    """Return the vector in its first unit. Raises RecordingError if its values in two units disagree."""
    first_values = read.vector(triples[0])
    for triple in triples[1:]:
        most = float(np.nanmax(np.abs(first_values), initial=0.0))
        if not np.allclose(read.vector(triple), first_values, rtol=0.0, atol=_AGREED * most, equal_nan=True):
            first, second = (layout.names[one.at[0]] for one in (triples[0], triple))
            raise RecordingError(
                f"{path}: {first!r} and {second!r} differ even in the same unit; choose one with --columns "
                f"{','.join(layout.names[at] for at in triples[0].at)}"
            )
    return first_values


def _by_gravity(layout: Layout, triple: Triple, accel: Floats) -> tuple[float | None, str]:
    """Return the factor still to apply, and a note: gravity tells g, mg and m/s² apart if no unit is stated."""
    if triple.factor is not None:
        return 1.0, ""
    name = layout.names[triple.at[0]] or f"column {triple.at[0] + 1}"
    lengths = np.linalg.norm(accel[np.isfinite(accel).all(axis=1)], axis=1)
    length = float(np.median(lengths)) if len(lengths) else 0.0
    for unit in ("g", "m/s2", "mg"):
        if abs(length * ACCEL[unit] / STANDARD_GRAVITY - 1) < _NEAR_GRAVITY:
            note = (
                f"the unit of {name!r} is not stated; {unit} is used, as its median length of {length:.4g} is gravity"
            )
            return ACCEL[unit], note
    return None, (
        f"{name!r} is not used: its unit is not stated, and its median length of {length:.4g} is not gravity in g, m/s² or "
        "mg. Give --accel-unit; for raw counts give the counts per g with --accel-sensitivity"
    )


def _best_clock(path: Path, layout: Layout, clocks: list[tuple[Clock, Floats]]) -> tuple[Floats, float, str]:
    """Return times in seconds, seconds per count of the chosen column, and a note. Raises RecordingError."""
    scaled = []
    for clock, time in clocks:
        factor, said = _unit(path, layout, clock, time)
        scaled.append((clock.rank - 10 * _evenness(time), clock, time, factor, said))
    scaled.sort(key=lambda one: one[0])
    _, clock, time, factor, said = scaled[0]
    even = {layout.names[c.at]: _step(t) * f for _, c, t, f, _ in scaled if not c.text and _evenness(t) > _EVENLY}
    if even and max(even.values()) > _SAME_STEP * min(even.values()):
        rates = "; ".join(f"{name!r} at {1 / step:.4g} Hz" for name, step in even.items())
        raise RecordingError(
            f"{path}: the time columns disagree: {rates}. Choose one, such as --time-column {next(iter(even))!r}"
        )
    name = layout.names[clock.at]
    others = [layout.names[one[1].at] for one in scaled[1:]]
    if others and (name, others) != _OWN_TIMES:
        said = f"{said}; " if said else ""
        said += f"the time column is {name!r}; other times are not used: {shown(others)}"
    return time * factor if factor != 1.0 else time, factor, said


def _step(time: Floats) -> float:
    return float(np.median(np.diff(time)))


def _evenness(time: Floats) -> float:
    """Return the share of steps near the median step."""
    steps = np.diff(time)
    middle = float(np.median(steps)) if len(steps) else 0.0
    return float(np.mean(np.abs(steps - middle) < _EVEN * middle)) if middle > 0 else 0.0


def _unit(path: Path, layout: Layout, clock: Clock, time: Floats) -> tuple[float, str]:
    """Return seconds per count, and a note: as stated, else the only unit that makes the rate one of an IMU."""
    if clock.text:
        return 1.0, ""
    if clock.factor is not None:
        return clock.factor, ""
    name = layout.names[clock.at] or f"column {clock.at + 1}"
    finite = time[np.isfinite(time)]
    steps = np.diff(finite)
    span = float(np.median(np.abs(steps))) if len(steps) else 0.0
    if not span and len(steps):
        span = float(np.ptp(finite)) / len(steps)
    fits = [unit for unit in ("s", "ms", "us", "ns") if span and _SLOW_HZ <= 1 / (span * TIME[unit]) <= _FAST_HZ]
    if fits:
        note = f"the unit of {name!r} is not stated; {fits[0]} is used, as only so do steps of {span:.6g} fit an IMU's rate"
        return TIME[fits[0]], note
    if not span:
        return 1.0, ""
    raise RecordingError(
        f"{path}: the unit of {name!r} is not stated, and in no unit do its steps of {span:.6g} fit an IMU's rate: give "
        "--time-unit, or the device's rate with --rate-hz"
    )


def _join(path: Path, table: Table, other_path: Path, other: Table) -> None:
    """Add another file's accelerometer to the table, interpolated at the rates' times. Raises RecordingError."""
    ours, theirs = table.columns.get("t_s"), other.columns.get("t_s")
    if "accel_m_s2" not in other.columns:
        raise RecordingError(f"{other_path}: no usable accelerometer: {'; '.join(other.notes)}")
    accel = other.columns["accel_m_s2"]
    if ours is None or theirs is None:
        if len(accel) != len(table.columns["gyro_rad_s"]):
            raise RecordingError(
                f"{other_path} has {count(len(accel), 'row')}, {path} has {count(len(table.columns['gyro_rad_s']), 'row')}: "
                "without times the rows cannot be matched: export both files with times"
            )
        table.columns["accel_m_s2"] = accel
        return
    good = np.isfinite(theirs) & np.isfinite(accel).all(axis=1)
    order = np.argsort(theirs[good], kind="stable")
    known, values = theirs[good][order], accel[good][order]
    inside = (ours >= known[0]) & (ours <= known[-1]) if len(known) else np.zeros(len(ours), bool)
    if np.mean(inside) < 0.5:
        raise RecordingError(
            f"{other_path}: the times cover less than half of {path}: give the accelerometer file of the same session"
        )
    table.columns["accel_m_s2"] = np.stack([np.interp(ours, known, values[:, axis]) for axis in range(3)], axis=1)
    table.notes.append(f"the accelerometer is read from {other_path.name} and interpolated")
