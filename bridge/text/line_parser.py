"""Parser of one text line of a device: converts the line to a sample in SI units, or refuses it with a reason.

A value that cannot be read is never guessed.
"""

import math
import re
from collections.abc import Mapping
from typing import NamedTuple

from bridge.terminal.plurals import count
from bridge.text.profile import NUMBER, Profile
from bridge.text.units import TICKS

Vector = tuple[float, float, float]
ROW_SHORT, ROW_LONG, NOT_A_NUMBER, NO_MATCH = "row_short", "row_long", "not_a_number", "no_match"
NO_HEADER, HEADER_INCOMPLETE = "no_header", "header_incomplete"
DECIMAL_TICK_S = 1e-6  # tick period of a decimal time
_LATEST_TICK = 2**53  # integers are exact in a float up to here
_WHOLE = re.compile(r"([0-9]+)(?:\.0*)?")


class Row(NamedTuple):
    """Sample parsed from one text line, in SI units; None stands for a quantity that was not measured.

    tick: count of the device's clock, in the profile's time unit. A decimal time is counted in µs; without a clock the
    count is 0. gyro (3,): x, y, z rates, rad/s, sensor axes. accel (3,): x, y, z, m/s², sensor axes.
    temperature_c: °C. battery_percent: 0 to 100.
    """

    tick: int
    gyro: Vector
    accel: Vector | None
    temperature_c: float | None
    battery_percent: float | None = None


class Header(NamedTuple):
    """Header row that a device printed. names: the column names, in order, of all rows until the next header."""

    names: tuple[str, ...]


class Refused(NamedTuple):
    """Line that could not be parsed.

    fault: label under which the line is counted, such as `row_short` or `not_a_number`. detail: what was received and
    what was expected.
    """

    fault: str
    detail: str


class Conversion:
    """Conversion of a row's texts to a sample in SI units, by the units and scales of a profile."""

    def __init__(self, profile: Profile) -> None:
        self._profile, accel = profile, profile.accel
        self._marks = str.maketrans(",.", ".,") if profile.decimal == "," else {}
        self._gyro = _Three(profile.gyro.columns, *map(float, profile.gyro.factor))
        self._accel = None if accel is None else _Three(accel.columns, *map(float, accel.factor))

    def row(self, texts: Mapping[str, str]) -> Row | Refused:
        """Convert a row's texts, by column name, to a sample.

        texts: the gyro's three columns are required; other missing columns count as not measured. The result is Refused
        if a text is not a number or not a time.
        """
        time, temperature, battery = self._profile.time, self._profile.temperature, self._profile.battery
        accel = self._accel
        if self._marks:
            texts = {column: text.translate(self._marks) for column, text in texts.items()}
        try:
            return Row(
                tick=0
                if time is None or time.column not in texts
                else _tick(texts[time.column], time.unit, time.width),
                gyro=self._gyro.of(texts),
                accel=None if accel is None or not texts.keys() >= {*accel.columns} else accel.of(texts),
                temperature_c=None
                if temperature is None or temperature.column not in texts
                else temperature.scale * _number(texts[temperature.column]) + temperature.offset_c,
                battery_percent=None
                if battery is None or not texts.get(battery.column)  # empty in most rows of some devices
                else min(100.0, max(0.0, battery.scale * _number(texts[battery.column]))),
            )
        except ValueError as error:
            return Refused(NOT_A_NUMBER, str(error))


class _Three(NamedTuple):
    """Three columns and their factors."""

    columns: tuple[str, str, str]
    x: float
    y: float
    z: float

    def of(self, texts: Mapping[str, str]) -> Vector:
        x, y, z = (_number(texts[column]) for column in self.columns)
        return x * self.x, y * self.y, z * self.z


class CsvReader:
    """Parser of lines that are rows of columns; the columns are named by the profile or by the latest header row.

    needs_clock: True refuses a header row without the profile's time column, because the sample rate would be unknown.
    has_clock: True if rows have a time; None until that is known.
    """

    def __init__(self, profile: Profile, *, needs_clock: bool) -> None:
        assert profile.csv is not None
        self._csv = profile.csv
        self._profile = profile
        self._conversion = Conversion(profile)
        self._needs_clock = needs_clock
        self._names = profile.csv.columns
        self._known = {column for column, _ in profile.needed}
        self.has_clock = profile.time is not None if self._names else None

    def read(self, line: str) -> Row | Header | Refused:
        """Parse one line: a row of numbers to a Row, a row of column names to a Header, any other line to Refused.

        A header row sets the order of the columns for the following rows.
        """
        if not line.startswith(self._csv.prefix):
            return Refused(NO_MATCH, f"the line does not begin with {self._csv.prefix!r}")
        fields = self._split(line.removeprefix(self._csv.prefix))
        if self._csv.header and not self._known.isdisjoint(fields):
            return self._header(tuple(fields))
        if not self._names:
            return Refused(NO_HEADER, "no header row yet: restart the device, which prints it at the start")
        if len(fields) != len(self._names):
            fault = ROW_SHORT if len(fields) < len(self._names) else ROW_LONG
            return Refused(fault, f"{count(len(fields), 'column')} found, {len(self._names)} expected")
        return self._conversion.row(dict(zip(self._names, fields, strict=True)))

    def _split(self, row: str) -> list[str]:
        if self._csv.separator == " ":
            return row.split()
        fields = [field.strip() for field in row.split(self._csv.separator)]
        return fields[:-1] if not fields[-1] else fields  # some devices end every row with a separator

    def _header(self, names: tuple[str, ...]) -> Header | Refused:
        time = self._profile.time
        has_clock = time is not None and time.column in names
        missing = [column for column in self._profile.gyro.columns if column not in names]
        if time is not None and not has_clock and self._needs_clock:
            missing.append(time.column)
        if missing or len(set(names)) < len(names):
            self._names = ()
            what = f"the header lacks {', '.join(missing)}" if missing else "the header names a column twice"
            return Refused(HEADER_INCOMPLETE, f"{what}; rows are ignored until a valid header comes")
        self._names, self.has_clock = names, has_clock
        return Header(names)


class RegexReader:
    """Parser of lines that match the profile's pattern as a whole; the pattern's named groups are the columns.

    has_clock: True if the profile has a time column.
    """

    def __init__(self, profile: Profile) -> None:
        assert profile.regex is not None
        self.has_clock: bool | None = profile.time is not None
        self._pattern = re.compile(profile.regex.match)
        self._conversion = Conversion(profile)
        self._always = {*profile.gyro.columns} | ({profile.time.column} if profile.time else set())

    def read(self, line: str) -> Row | Header | Refused:
        """Parse one line to a Row.

        The result is Refused if the line does not match, lacks a gyro or time column, or has an invalid number.
        """
        match = self._pattern.fullmatch(line)
        if match is None:
            return Refused(NO_MATCH, "the line does not match the profile's pattern")
        texts = {name: text.strip() for name, text in match.groupdict().items() if text is not None}
        if missing := self._always - texts.keys():
            return Refused(NO_MATCH, f"the line lacks {', '.join(sorted(missing))}")
        return self._conversion.row(texts)


#: parser of one device's lines: each line becomes a sample, a header row or a refusal
Reader = CsvReader | RegexReader


def _number(text: str) -> float:
    number = float(text) if NUMBER.fullmatch(text) else math.nan
    if not math.isfinite(number):
        raise ValueError(f"{text!r} is not a number")
    return number


def _tick(text: str, unit: str, bits: int) -> int:
    if not bits:
        tick = _number(text) * TICKS[unit] / DECIMAL_TICK_S
        if 0 <= tick <= _LATEST_TICK:
            return round(tick)
        raise ValueError(f"{text!r} is not a time")
    whole = _WHOLE.fullmatch(text)
    if whole is None or int(whole[1]) >= 1 << bits:
        raise ValueError(f"{text!r} is not a time: a whole number below 2**{bits} is expected")
    return int(whole[1])
