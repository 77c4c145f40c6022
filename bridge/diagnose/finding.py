"""The result of one check: a level, what was found, and what to do."""

from dataclasses import dataclass
from enum import Enum


class Level(Enum):
    """How bad it is: `warning` works today, `trouble` does not."""

    OK = "ok"
    WARNING = "warning"
    TROUBLE = "trouble"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at: what it is, how it is, and what to do unless it is well."""

    check: str
    level: Level
    said: str
    do: str = ""


def ok(check: str, said: str) -> Finding:
    """All is well."""
    return Finding(check, Level.OK, said)


def warning(check: str, said: str, do: str) -> Finding:
    """It works, but not always, or not well."""
    return Finding(check, Level.WARNING, said, do)


def trouble(check: str, said: str, do: str) -> Finding:
    """It does not work."""
    return Finding(check, Level.TROUBLE, said, do)
