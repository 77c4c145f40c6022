"""The result of one check: a level, what was found, and what to do."""

from dataclasses import dataclass
from enum import Enum


class Level(Enum):
    """Severity of a finding: with `warning` it works today, with `trouble` it does not."""

    OK = "ok"
    WARNING = "warning"
    TROUBLE = "trouble"


@dataclass(frozen=True, slots=True)
class Finding:
    """Result of one check: what was checked, its state, and what to do if it is not ok."""

    check: str
    level: Level
    said: str
    do: str = ""


def ok(check: str, said: str) -> Finding:
    """A finding that all is well."""
    return Finding(check, Level.OK, said)


def warning(check: str, said: str, do: str) -> Finding:
    """A finding of something that works, but not always or not well."""
    return Finding(check, Level.WARNING, said, do)


def trouble(check: str, said: str, do: str) -> Finding:
    """A finding of something that does not work."""
    return Finding(check, Level.TROUBLE, said, do)
