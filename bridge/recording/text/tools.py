"""Columns of known tools' exports, a TOML file each in configs/columns, or a user's own.

summary = "Sensor Logger's Gyroscope.csv"
header = ["seconds_elapsed", "z", "y", "x"]   recognised by these names, all of them
file = "*gyro*"                               and by the file's name, where others have the same header
[gyro]    columns = ["x", "y", "z"]   unit = "rad/s"   (or sensitivity = counts per °/s)
[accel]   the same                                     (or sensitivity = counts per g)
[time]    column = "seconds_elapsed"  unit = "s"
"""

from fnmatch import fnmatch
from functools import lru_cache
from pathlib import Path

from msgspec import Struct

from bridge.recording.units import ACCEL, GYRO, TIME, unit_in
from bridge.toml.loader import load
from bridge.toml.shipped import file_of, shipped

_HERE = Path(__file__).parent
_FOLDERS = (
    _HERE / "columns_of_tools",
    _HERE.parents[2] / "configs" / "columns",
)  # of an installed package; of a checkout


class Vector(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Three columns, x y z, and their unit, or their raw counts per °/s or per g."""

    columns: tuple[str, str, str]
    unit: str = ""
    sensitivity: float = 0.0

    def __post_init__(self) -> None:
        if self.unit and unit_in(self.unit, GYRO) is None and unit_in(self.unit, ACCEL) is None:
            raise ValueError(f"unit is {self.unit!r}; one of {', '.join([*GYRO, *ACCEL])} is expected")
        if not 0 <= self.sensitivity < 1e9:
            raise ValueError(f"sensitivity is {self.sensitivity:g}; counts per °/s or per g are expected")

    def factor(self, known: dict[str, float], per: str) -> float | None:
        """From the column's numbers to SI; None where the tool's file does not fix the unit."""
        return known[per] / self.sensitivity if self.sensitivity else unit_in(self.unit, known)


class Time(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The column with the time of a sample."""

    column: str
    unit: str = ""

    def __post_init__(self) -> None:
        if self.unit and unit_in(self.unit, TIME) is None:
            raise ValueError(f"unit is {self.unit!r}; one of {', '.join(TIME)} is expected")


class Tool(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The export of one tool. It is recognised by names letter for letter: another tool's may differ by case alone."""

    summary: str = ""
    header: tuple[str, ...] = ()
    file: str = "*"
    gyro: Vector | None = None
    accel: Vector | None = None
    time: Time | None = None

    def is_of(self, path: Path, names: list[str]) -> bool:
        """Whether a file is an export of this tool."""
        there = set(names)
        fits = fnmatch(path.name.lower(), self.file.lower())
        return bool(self.header) and fits and there.issuperset(self.header)


def plain(name: str) -> str:
    """A column's name as it is compared."""
    return " ".join(name.lower().split())


@lru_cache(maxsize=1)
def known() -> dict[str, Tool]:
    """The tools that come with truerate."""
    return {name: load(path, Tool) for name, path in shipped(_FOLDERS).items()}


def tool(name: str) -> Tool:
    """One by its name, or of a file of one's own. Raises ConfigError."""
    return load(file_of(name, "tool with columns", _FOLDERS), Tool)
