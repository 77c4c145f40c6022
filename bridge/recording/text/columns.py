"""Search for the columns of a text table: rates, acceleration and time, with their factors to SI."""

from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path

from bridge.recording.error import RecordingError
from bridge.recording.reading import Reading
from bridge.recording.text.layout import Layout, is_number
from bridge.recording.text.names import Name, understood
from bridge.recording.text.times import is_clock
from bridge.recording.text.tools import Tool, Vector, known, plain, tool
from bridge.text.units import ACCEL, GYRO, TIME, unit_in

AXES = "xyz"
_SHOWN = 12


@dataclass(slots=True)
class Triple:
    """Three columns of a text table that hold the x, y, z of one vector.

    at: their indices, from 0. factor: from their numbers to SI; None if no unit is stated. unit: standard spelling of
    the stated unit; empty if no unit is stated.
    """

    at: tuple[int, int, int]
    factor: float | None
    unit: str = ""


@dataclass(slots=True)
class Clock:
    """Time column of a text table.

    at: its index, from 0. factor: from its numbers to seconds; None if no unit is stated. text: True if the column
    holds dates or times of day. rank: preference among several time columns; the lowest is used first.
    """

    at: int
    factor: float | None
    text: bool = False
    rank: int = 0


@dataclass(slots=True)
class Columns:
    """Meaning of a text table's columns.

    gyro: the rates, one Triple for each unit in which the file states them. accel: likewise for the acceleration.
    clocks: all time columns. counter, temperature, rate: index of the column with sample numbers, with temperatures in
    °C, and with the sampling rate in Hz; None if there is none.
    numbers: indices of all columns to read as numbers. unused: names of columns of incomplete vectors. notes: sentences
    for the user on the choice of columns.
    """

    gyro: list[Triple]
    accel: list[Triple] = field(default_factory=list)
    clocks: list[Clock] = field(default_factory=list)
    counter: int | None = None
    temperature: int | None = None
    rate: int | None = None
    numbers: list[int] = field(default_factory=list)
    unused: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def find(
    path: Path, layout: Layout, reading: Reading, cells: list[str], *, only_accel: bool = False, tag: str = ""
) -> Columns:
    """Find the columns with rates, acceleration, time and others, by their names and the user's options.

    path: the file, for errors and for tools recognised by the file name. cells: the first row of numbers, as texts.
    only_accel: True looks for an accelerometer alone. tag: the sensor's tag in each row, if rows have one.
    Raises RecordingError if the columns of the rates are missing or ambiguous.
    """
    sensor = f"{path.name} {tag}".lower()
    names = [understood(name) for name in layout.names]
    found = Columns([])
    chosen = _chosen(path, layout, reading)
    if chosen is not None:
        _by_tool(path, layout, chosen, found)
    if len(reading.columns) >= 3:
        indices = [_index(path, layout, name, "--columns") for name in reading.columns]
        found.gyro = [_triple(indices[:3], names)]
        found.accel = [_triple(indices[3:], names)] if indices[3:] else []
    if not found.gyro and not only_accel:
        found.gyro = _vector(path, layout, names, "gyro", sensor)
    if not found.accel and len(reading.columns) != 3:
        found.accel = _accel(path, layout, names, found, sensor)
    if not found.gyro and not only_accel:
        raise RecordingError(f"{path}: {_no_gyro(layout)}")
    if only_accel:
        found.gyro = []
    _with_options(layout, reading, found)
    _times(path, layout, reading, names, cells, found)
    firsts = {name.kind: at for at, name in reversed(list(enumerate(names)))}
    found.temperature, found.rate = firsts.get("temperature"), firsts.get("rate")
    found.counter = next(
        (at for at, name in enumerate(names) if name.kind == "counter" and is_number(cells[at], layout.decimal)), None
    )
    used = {at for triple in (*found.gyro, *found.accel) for at in triple.at}
    found.unused = [
        name for at, name in enumerate(layout.names) if names[at].kind in {"gyro", "accel"} and at not in used
    ]
    if asked := _asked(reading, layout, found, only_accel=only_accel):
        raise RecordingError(f"{path}: {asked}")
    singles = {at for at in (found.counter, found.temperature, found.rate) if at is not None}
    found.numbers = sorted(used | singles | {clock.at for clock in found.clocks if not clock.text})
    return found


def shown(names: list[str]) -> str:
    """Return names as a text for a message: the first 12, separated by commas, and the number of all names if more."""
    more = f" … ({len(names)} in all)" if len(names) > _SHOWN else ""
    return ", ".join(name[:40] or "(no name)" for name in names[:_SHOWN]) + more


def _chosen(path: Path, layout: Layout, reading: Reading) -> Tool | None:
    if len(reading.columns) == 1:
        return tool(reading.columns[0])
    return next((one for one in known().values() if one.is_of(path, layout.names)), None)


def _by_tool(path: Path, layout: Layout, chosen: Tool, found: Columns) -> None:
    def triple(vector: Vector | None, known_units: dict[str, float], per: str) -> list[Triple]:
        if vector is None:
            return []
        indices = [_index(path, layout, name, "the tool's file") for name in vector.columns]
        factor = vector.factor(known_units, per)
        return [Triple((indices[0], indices[1], indices[2]), factor, vector.unit)]

    found.gyro, found.accel = triple(chosen.gyro, GYRO, "deg/s"), triple(chosen.accel, ACCEL, "g")
    if chosen.time is not None:
        at = _index(path, layout, chosen.time.column, "the tool's file")
        found.clocks = [Clock(at, unit_in(chosen.time.unit, TIME) if chosen.time.unit else None)]
    found.notes.append(f"read as {chosen.summary}")


def _index(path: Path, layout: Layout, name: str, of: str) -> int:
    """Return the index of a column from its name, or its number from 1. Raises RecordingError."""
    names = [plain(one) for one in layout.names]
    if plain(name) in names:
        return names.index(plain(name))
    if name.strip().isdecimal() and 1 <= int(name) <= layout.width:
        return int(name) - 1
    raise RecordingError(
        f"{path}: {of} names the unknown column {name!r}: use {shown(layout.names)}, or a number from 1 to {layout.width}"
    )


def _triple(indices: list[int], names: list[Name]) -> Triple:
    units = {names[at].unit for at in indices}
    unit = units.pop() if len(units) == 1 else ""
    return Triple((indices[0], indices[1], indices[2]), {**GYRO, **ACCEL}.get(unit), unit)


def _vector(path: Path, layout: Layout, names: list[Name], kind: str, sensor: str) -> list[Triple]:
    """Return the triples of columns of one kind: one, or the same vector in several units. Raises RecordingError."""
    # Columns named x, y, z alone belong to the sensor in the name of the file or in the rows' tag.
    word, units = {"gyro": ("gyr", GYRO), "accel": ("acc", ACCEL)}[kind]
    bare = word in sensor
    for wanted in (kind, "axis"):
        alike = [
            (name, at)
            for at, name in enumerate(names)
            if name.kind == wanted and (wanted == kind or name.unit in units or (bare and not name.unit))
        ]
        alike.sort(key=lambda one: (one[0].group, one[0].unit, one[1]))
        whole = dict[tuple[str, ...], list[Triple]]()
        for (group, unit), members in groupby(alike, key=lambda one: (one[0].group, one[0].unit)):
            axes = {axis: [at for name, at in list_ if name.axis == axis] for list_ in [list(members)] for axis in AXES}
            if twice := next((ats for ats in axes.values() if len(ats) > 1), None):
                raise RecordingError(
                    f"{path}: the header has {layout.names[twice[0]]!r} more than once; choose by number with --columns "
                    f"{','.join(str(at + 1) for at in sorted(ats[0] for ats in axes.values() if ats))}"
                )
            if all(axes.values()):
                at = axes["x"][0], axes["y"][0], axes["z"][0]
                whole.setdefault(_sensor(group), []).append(Triple(at, units.get(unit), unit))
        if len(whole) > 1:
            each = [",".join(layout.names[at] for at in triples[0].at) for triples in whole.values()]
            raise RecordingError(
                f"{path}: {len(whole)} sensors have {kind} columns: {'; '.join(each[:4])}; choose one sensor, such as"
                f" --columns {each[0]}"
            )
        if whole:
            found = next(iter(whole.values()))
            said = [triple for triple in found if triple.factor is not None]
            return said or found[:1]
    return []


def _accel(path: Path, layout: Layout, names: list[Name], found: Columns, sensor: str) -> list[Triple]:
    """Return the accelerometer's columns; none, with a note, if several sensors have some."""
    try:
        return _vector(path, layout, names, "accel", sensor)
    except RecordingError as several:
        found.notes.append(
            f"no accelerometer is used: {str(several).removeprefix(f'{path}: ')} after the gyro's columns"
        )
        return []


def _sensor(group: tuple[str, ...]) -> tuple[str, ...]:
    """Return the words that tell a sensor from others; short and long names of the quantity are left out."""
    same = {"g", "w", "a", "gyr", "gyro", "gyroscope", "acc", "accel", "accelerometer", "acceleration"}
    return tuple(word for word in group if word not in same)


def _with_options(layout: Layout, reading: Reading, found: Columns) -> None:
    for triples, said, factor, units, option in (
        (found.gyro, layout.gyro_unit, reading.gyro_factor, GYRO, "--gyro-unit"),
        (found.accel, layout.accel_unit, reading.accel_factor, ACCEL, "--accel-unit"),
    ):
        for triple in triples:
            if factor is not None:
                if triple.factor is not None and abs(triple.factor / factor - 1) > 1e-6:
                    found.notes.append(f"the header states {triple.unit or 'another unit'}; {option} replaces it")
                triple.factor = factor
            elif triple.factor is None and said:
                triple.factor = unit_in(said, units)


def _times(path: Path, layout: Layout, reading: Reading, names: list[Name], cells: list[str], found: Columns) -> None:
    if reading.time_column is not None:
        at = _index(path, layout, reading.time_column, "--time-column")
        found.clocks = [Clock(at, TIME.get(names[at].unit), text=not is_number(cells[at], layout.decimal))]
    elif not found.clocks:
        found.clocks = [
            Clock(at, TIME.get(name.unit), text=not number, rank=name.rank + 4 * (not number))
            for at, name in enumerate(names)
            if name.kind == "time" and ((number := is_number(cells[at], layout.decimal)) or is_clock(cells[at]))
        ]
    if reading.time_factor is not None:
        for clock in found.clocks:
            clock.factor = reading.time_factor


def _asked(reading: Reading, layout: Layout, columns: Columns, *, only_accel: bool) -> str:
    """Say which facts neither the file nor an option gives, and the options for them; empty if nothing is missing."""
    if only_accel:
        return "" if columns.accel else f"no accelerometer columns recognised; the header has {shown(layout.names)}"
    missing = []
    if columns.gyro[0].factor is None:
        name = layout.names[columns.gyro[0].at[0]] or f"column {columns.gyro[0].at[0] + 1}"
        missing.append(
            f"the unit of {name!r} is unknown: give --gyro-unit deg/s or --gyro-unit rad/s; for raw counts give "
            "--gyro-sensitivity with the counts per °/s of the data sheet (131 for an MPU-6050 at ±250 °/s)"
        )
    if not columns.clocks and not layout.rate_hz and columns.rate is None and reading.rate_hz is None:
        missing.append("neither sample times nor a rate: give the device's output data rate with --rate-hz")
    return "; and ".join(missing)


def _no_gyro(layout: Layout) -> str:
    if not any(layout.names):
        return (
            f"no header row names the {layout.width} columns. Give the numbers of gyro x, y, z (and accelerometer x, y, z), the "
            "unit and the time column: --columns 2,3,4 --gyro-unit deg/s --time-column 1"
        )
    return (
        f"no gyro columns recognised; the header has {shown(layout.names)}. Give the names or numbers of x, y, z and the "
        "unit: --columns NAME,NAME,NAME --gyro-unit deg/s"
    )
