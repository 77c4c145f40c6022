"""Text profiles: TOML descriptions of the lines that a device prints, one file for each kind of device.

    summary = "one line for the user"
    baud = 115200                     # bits per second of the port, unless the ward's file states another rate
    decimal = ","                     # decimal mark of the numbers; default "."
    banners = ['regular expression']  # a line printed at the start, which means a boot. Named groups model, firmware,
                                      # rate_hz and gyro_range_dps set these properties
    ignore = ['regular expression']   # lines that are neither samples nor faults
    [device]                          model, firmware, gyro_range_dps (0: unknown), rate_hz if there is no clock
    [csv]                             this table or [regex]:
    separator = ","                   #   one character; " " means any blanks
    columns = ["t", "gx", "gy"]       #   names in order; if left out, a header row must come first
    header = true                     #   a row of names, at any time, sets the order
    prefix = "Raw:"                   #   text at the beginning of each row
    [regex]
    match = '(?P<gx>[-0-9.]+) ...'    #   pattern of a whole line; its named groups are the columns
    [gyro]
    columns = ["gx", "gy", "gz"]      # x, y, z
    unit = "dps"                      # rad/s, mrad/s, dps, mdps; or counts, with sensitivity_mdps (m°/s per count)
    scale = 1.0                       # additional factor; a list of three if axes differ or point the other way
    [accel]                           the same; m/s2, g, mg; or counts, with sensitivity_mg (mg per count). Optional
    [temperature]                     column, scale, offset_c: °C = scale * value + offset_c. Optional
    [battery]                         column, scale: % = scale * value, limited to 0 to 100. Optional
    [time]                            column, unit (s, ms, us, ns), bits. Optional if rate_hz is known
    [[known_scale_faults]]            factor, cause, gyro_range_dps: the true rate is `factor` times the printed rate
    [notices]                         name = "what a person should know of this device"

bits: the time is a whole number that wraps at 2**bits (default for ms and us: 32, for ns: 64); 0 means a decimal
number that never wraps.
A pattern must match a whole line, without surrounding blanks; a banner may also follow an incomplete line that a
restart interrupted. The profiles shipped with truerate are in configs/profiles, or in the installed package.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final, Literal

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from bridge.reasons.codes import Code, Sentence
from bridge.text.units import ACCEL, GYRO, STANDARD_GRAVITY, TICKS, unit_in
from bridge.toml.loader import load, nearest
from bridge.toml.shipped import file_of
from bridge.toml.shipped import shipped as in_folders
from bridge.wire.validation import MAX_SENTENCE

_HERE = Path(__file__).parent.parent
_FOLDERS = (_HERE / "profiles", _HERE.parent / "configs" / "profiles")  # of an installed package; of a checkout
#: unit of raw counts, whose sensitivity is given beside it
_COUNTS: Final = "counts"
BANNER_GROUPS: Final = ("model", "firmware", "rate_hz", "gyro_range_dps")
NUMBER: Final = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")


class Device(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Table [device] of a profile: properties that the device's lines do not state.

    gyro_range_dps: full-scale range, °/s; 0 if unknown. rate_hz: output data rate, Hz; 0 if the lines have a time.
    Raises ValueError for an empty model name, and for a number out of range.
    """

    model: str
    firmware: str = ""
    gyro_range_dps: float = 0.0
    rate_hz: float = 0.0

    def __post_init__(self) -> None:
        _within("gyro_range_dps", self.gyro_range_dps, 0, 10_000)
        _within("rate_hz", self.rate_hz, 0, 10_000)
        if not (self.model and self.model.isprintable()):
            raise ValueError(f"model is {self.model!r}: give the name of the model")


class Csv(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Table [csv] of a profile: how a line splits into columns.

    separator: one character; " " means any blanks. columns: names in order; empty if a header row names them.
    header: True if a row of names may come at any time. prefix: text at the beginning of each row, which is removed.
    Raises ValueError if columns or separator cannot be used.
    """

    separator: str = ","
    columns: tuple[str, ...] = ()
    header: bool = False
    prefix: str = ""

    def __post_init__(self) -> None:
        if len(self.separator) != 1 or self.separator in "\r\n+-.0123456789eE":
            raise ValueError(
                f"separator is {self.separator!r}: use one character that occurs in no number, such as ','"
            )
        if not self.columns and not self.header:
            raise ValueError(
                "[csv] has neither columns nor header: list the columns in their order, or write header = true"
            )
        for column in self.columns:
            if self.columns.count(column) > 1:
                raise ValueError(f"columns has {column!r} more than once: name each column once")


class Regex(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Table [regex] of a profile: `match`, the pattern of a whole line, whose named groups are the columns.

    Raises ValueError for an invalid pattern, or one without named groups.
    """

    match: str

    def __post_init__(self) -> None:
        if not _compiled(self.match, "match").groupindex:
            raise ValueError("match has no named groups: write for example (?P<gx>[-0-9.]+)")


Axes = float | tuple[float, float, float]


class Gyro(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Table [gyro] of a profile: columns and unit of the angular rates about x, y and z.

    columns: names of the x, y, z columns. unit: one of units.GYRO, or `counts`. scale: additional factor without unit,
    one for all axes or one per axis. sensitivity_mdps: m°/s per count, for the unit `counts`.
    Raises ValueError for an unknown unit, and for a scale or sensitivity out of range.
    """

    columns: tuple[str, str, str]
    unit: str
    scale: Axes = 1.0
    sensitivity_mdps: float | None = None

    def __post_init__(self) -> None:
        _check_scale(self.scale)
        _ = self.factor

    @property
    def factor(self) -> NDArray[np.float64]:
        """Factors (3,) that convert the printed numbers of x, y, z to rad/s."""
        sensitivity = None if self.sensitivity_mdps is None else self.sensitivity_mdps * GYRO["mdeg/s"]
        return np.full(3, self.scale) * _in_si(self.unit, GYRO, sensitivity, "sensitivity_mdps")


class Accel(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Table [accel] of a profile: columns and unit of the accelerations along x, y and z.

    columns: names of the x, y, z columns. unit: one of units.ACCEL, or `counts`. scale: additional factor without unit,
    one for all axes or one per axis. sensitivity_mg: thousandths of g per count, for the unit `counts`.
    Raises ValueError for an unknown unit, and for a scale or sensitivity out of range.
    """

    columns: tuple[str, str, str]
    unit: str
    scale: Axes = 1.0
    sensitivity_mg: float | None = None

    def __post_init__(self) -> None:
        _check_scale(self.scale)
        _ = self.factor

    @property
    def factor(self) -> NDArray[np.float64]:
        """Factors (3,) that convert the printed numbers of x, y, z to m/s²."""
        sensitivity = None if self.sensitivity_mg is None else self.sensitivity_mg * STANDARD_GRAVITY * 1e-3
        return np.full(3, self.scale) * _in_si(self.unit, ACCEL, sensitivity, "sensitivity_mg")


class Temperature(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Table [temperature] of a profile: °C = scale * value + offset_c, where value is the number in `column`.

    Raises ValueError for a scale or offset out of range.
    """

    column: str
    scale: float = 1.0
    offset_c: float = 0.0

    def __post_init__(self) -> None:
        _check_scale(self.scale)
        _within("offset_c", self.offset_c, -1000, 1000)


class Battery(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Table [battery] of a profile: charge in % = scale * value, where value is the number in `column`.

    Raises ValueError for a scale out of range.
    """

    column: str
    scale: float = 1.0

    def __post_init__(self) -> None:
        _check_scale(self.scale)


class Time(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Table [time] of a profile: column and unit of the device's own clock.

    unit: unit of one count: s, ms, us or ns. bits: the count wraps at 2**bits; 0 for a decimal number that never wraps;
    None for the default that `width` gives.
    Raises ValueError for an unknown unit, and for bits out of range.
    """

    column: str
    unit: str
    bits: int | None = None

    def __post_init__(self) -> None:
        if self.unit not in TICKS:
            raise ValueError(f"unknown unit {self.unit!r}; {nearest(self.unit, TICKS)}")
        if self.bits is not None and not (self.bits == 0 or 8 <= self.bits <= 64):
            raise ValueError(f"bits is {self.bits}: use 8 to 64, or 0 for a time that never wraps")

    @property
    def width(self) -> int:
        """Number of bits after which the clock's count wraps; 0 for a decimal number that never wraps.

        The default is 0 for seconds, 32 for ms and us, and 64 for ns.
        """
        return {"s": 0, "ns": 64}.get(self.unit, 32) if self.bits is None else self.bits


class ScaleFault(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Table [[known_scale_faults]] of a profile: a known scale error in the software of one kind of device.

    factor: true rate divided by printed rate, 0.1 to 10. cause: reason, for the user. gyro_range_dps: full-scale range
    at which the error occurs, °/s; 0 for any. Raises ValueError for a factor out of range.
    """

    factor: float
    cause: str
    gyro_range_dps: float = 0.0

    def __post_init__(self) -> None:
        _within("factor", self.factor, 0.1, 10)

    @property
    def said(self) -> Sentence:
        """Message to the user about the scale error.

        The message states by how many percent the device reads low or high, the cause, and the factor that corrects it.
        """
        code = Code.READS_LOW if self.factor > 1 else Code.READS_HIGH
        return code(percent=f"{100 * abs(1 - 1 / self.factor):.1f}", cause=self.cause, scale=f"{self.factor:g}")


class Profile(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Text profile of one kind of device: how to read its lines. The module's docstring explains every key.

    Raises ValueError if a value is invalid, or if tables or columns contradict each other.
    """

    summary: str
    device: Device
    gyro: Gyro
    accel: Accel | None = None
    temperature: Temperature | None = None
    battery: Battery | None = None
    time: Time | None = None
    csv: Csv | None = None
    regex: Regex | None = None
    baud: int = 115_200
    decimal: Literal[".", ","] = "."
    banners: tuple[str, ...] = ()
    ignore: tuple[str, ...] = ()
    known_scale_faults: tuple[ScaleFault, ...] = ()
    notices: dict[str, str] = {}

    def __post_init__(self) -> None:
        _within("baud", self.baud, 300, 4_000_000)
        if (self.csv is None) == (self.regex is None):
            raise ValueError("both or neither of [csv] and [regex] are given: give exactly one of these tables")
        if self.csv is not None and self.csv.separator == self.decimal:
            raise ValueError(f"decimal and separator are both {self.decimal!r}: give another separator")
        for banner in self.banners:
            for group in _compiled(banner, "banners").groupindex:
                if group not in BANNER_GROUPS:
                    raise ValueError(f"banners: unknown group {group!r}; {nearest(group, BANNER_GROUPS)}")
        for pattern in self.ignore:
            _compiled(pattern, "ignore")
        for name, text in self.notices.items():
            if len(text) > MAX_SENTENCE:
                raise ValueError(f"[notices]: {name} has {len(text)} characters; at most {MAX_SENTENCE} are allowed")
        self._check_columns()

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns: those of [csv] in order, or the named groups of [regex].

        Empty if only a header row names the columns.
        """
        if self.csv is not None:
            return self.csv.columns
        return tuple(re.compile(self.regex.match).groupindex) if self.regex is not None else ()

    @property
    def needed(self) -> tuple[tuple[str, str], ...]:
        """Columns that the profile reads, as pairs (column, table), such as ("gx", "gyro")."""
        vectors = [("gyro", self.gyro.columns), *([("accel", self.accel.columns)] if self.accel else [])]
        single = [("temperature", self.temperature), ("battery", self.battery), ("time", self.time)]
        return (
            *((column, table) for table, columns in vectors for column in columns),
            *((one.column, table) for table, one in single if one is not None),
        )

    def _check_columns(self) -> None:
        seen: dict[str, str] = {}
        for column, table in self.needed:
            if self.columns and column not in self.columns:
                raise ValueError(f"[{table}]: unknown column {column!r}; {nearest(column, self.columns)}")
            if column in seen:
                raise ValueError(
                    f"[{table}]: column {column!r} is already used by [{seen[column]}]: name another column"
                )
            if NUMBER.fullmatch(column):
                raise ValueError(f"[{table}]: column {column!r} is a number: give a name")
            seen[column] = table


def load_profile(name: str | Path) -> Profile:
    """Load a text profile: one shipped with truerate by its name, or any other by the path of its .toml file.

    Raises ConfigError for an unknown name or an invalid file.
    """
    return load(file_of(name, "profile", _FOLDERS), Profile)


def shipped() -> dict[str, Path]:
    """Return the paths of the profiles shipped with truerate, by profile name."""
    return in_folders(_FOLDERS)


def _compiled(pattern: str, key: str) -> re.Pattern[str]:
    try:
        return re.compile(pattern)
    except re.error as error:
        raise ValueError(f"{key}: {pattern!r} is not a regular expression: {error}") from None


def _within(key: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise ValueError(f"{key} is {value:g}: use {low:g} to {high:g}")


def _check_scale(scale: Axes) -> None:
    if not all(1e-9 <= abs(number) <= 1e9 for number in np.ravel(scale)):
        raise ValueError(f"scale is {scale}: give one factor, or three (x, y, z), none of them 0")


def _in_si(unit: str, units: Mapping[str, float], sensitivity: float | None, key: str) -> float:
    """SI value of one `unit`, or of one count of a sensor with this sensitivity (already SI).

    key: the sensitivity's name in the file. Raises ValueError with what is expected.
    """
    if unit != _COUNTS:
        factor = unit_in(unit, units)
        if factor is None:
            raise ValueError(f"unknown unit {unit!r}; {nearest(unit, (*units, _COUNTS))}")
        if sensitivity is not None:
            raise ValueError(f"{key} applies only to unit = {_COUNTS!r}, but unit is {unit!r}: remove it")
        return factor
    if sensitivity is None:
        raise ValueError(f"unit {_COUNTS!r} needs {key}: give the value from the sensor's data sheet")
    if not 0 < sensitivity < 1e6:
        raise ValueError(
            f"{key} is {sensitivity:g}: give the value of one count, above 0, as in the sensor's data sheet"
        )
    return sensitivity
