"""Descriptions of known tools' exports: one TOML file per tool, in configs/columns or a user's own.

summary = "Sensor Logger's Gyroscope.csv"
header = ["seconds_elapsed", "z", "y", "x"]   recognised if the header has all these names
file = "*gyro*"                               and by the file's name, if other exports have the same header
[gyro]    columns = ["x", "y", "z"]   unit = "rad/s"   (or sensitivity = counts per °/s)
[accel]   the same                                     (or sensitivity = counts per g)
[time]    column = "seconds_elapsed"  unit = "s"
"""

from fnmatch import fnmatch
from functools import lru_cache
from pathlib import Path

from msgspec import Struct

from bridge.text.units import ACCEL, GYRO, TIME, unit_in
from bridge.toml.loader import load
from bridge.toml.shipped import file_of, shipped

_HERE = Path(__file__).parent
_FOLDERS = (
    _HERE / "columns_of_tools",
    _HERE.parents[2] / "configs" / "columns",
)  # of an installed package; of a checkout


class Vector(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Three columns, x y z, of a tool's export, with the unit or the sensitivity of their numbers.

    unit: empty if unknown. sensitivity: raw counts per °/s or per g; 0 if the numbers are not counts.
    Raises ValueError for an unknown unit or a sensitivity out of range.
    """

    columns: tuple[str, str, str]
    unit: str = ""
    sensitivity: float = 0.0

    def __post_init__(self) -> None:
        if self.unit and unit_in(self.unit, GYRO) is None and unit_in(self.unit, ACCEL) is None:
            raise ValueError(f"unit is {self.unit!r}: use one of {', '.join([*GYRO, *ACCEL])}")
        if not 0 <= self.sensitivity < 1e9:
            raise ValueError(f"sensitivity is {self.sensitivity:g}: give the counts per °/s or per g")

    def factor(self, known: dict[str, float], per: str) -> float | None:
        """Return the factor that converts these columns' numbers to SI; None without a unit and a sensitivity.

        With a sensitivity (raw counts per unit `per`) the factor is known[per] / sensitivity, otherwise known[unit].
        known: factors to rad/s or m/s², by unit. per: `deg/s` for a gyro, `g` for an accelerometer.
        """
        return known[per] / self.sensitivity if self.sensitivity else unit_in(self.unit, known)


class Time(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Time column of a tool's export. column: its name. unit: unit of its numbers; empty if unknown.

    Raises ValueError for an unknown unit.
    """

    column: str
    unit: str = ""

    def __post_init__(self) -> None:
        if self.unit and unit_in(self.unit, TIME) is None:
            raise ValueError(f"unit is {self.unit!r}: use one of {', '.join(TIME)}")


class Tool(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Description of one tool's export: its columns, and how its files are recognised.

    header: column names that the file must have; case-sensitive, as names of other tools may differ by case alone.
    file: pattern of the file name, such as `*gyro*`. summary: name of the tool, for the user.
    """

    summary: str = ""
    header: tuple[str, ...] = ()
    file: str = "*"
    gyro: Vector | None = None
    accel: Vector | None = None
    time: Time | None = None

    def is_of(self, path: Path, names: list[str]) -> bool:
        """Return True if a file is an export of this tool, by its name and its column names.

        names: column names of the file, which must include those of `header`.
        """
        there = set(names)
        fits = fnmatch(path.name.lower(), self.file.lower())
        return bool(self.header) and fits and there.issuperset(self.header)


def plain(name: str) -> str:
    """Return a column's name in its form for comparison: lower case, with single blanks."""
    return " ".join(name.lower().split())


@lru_cache(maxsize=1)
def known() -> dict[str, Tool]:
    """Return the descriptions of tools' exports that are shipped with truerate, by name of the tool."""
    return {name: load(path, Tool) for name, path in shipped(_FOLDERS).items()}


def tool(name: str) -> Tool:
    """Load the description of a tool's export: a shipped one by name, or a user's .toml file by path.

    Raises ConfigError for an unknown name or an invalid file.
    """
    return load(file_of(name, "tool with columns", _FOLDERS), Tool)
