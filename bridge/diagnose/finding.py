"""The result of one check: a level, what was found, and what to do."""

from dataclasses import dataclass
from enum import Enum


class Level(Enum):
    """Severity of a finding: OK; WARNING, it works now but may fail; TROUBLE, it does not work."""

    OK = "ok"
    WARNING = "warning"
    TROUBLE = "trouble"


@dataclass(frozen=True, slots=True)
class Finding:
    """Result of one check: name of the check, level, what was found (said), and what to do if it is not ok (do)."""

    check: str
    level: Level
    said: str
    do: str = ""


def ok(check: str, said: str) -> Finding:
    """Return a finding that all is well. said: what was found."""
    return Finding(check, Level.OK, said)


def warning(check: str, said: str, do: str) -> Finding:
    """Return a finding of something that works, but not always or not well. do: what to do."""
    return Finding(check, Level.WARNING, said, do)


def trouble(check: str, said: str, do: str) -> Finding:
    """Return a finding of something that does not work. do: what to do."""
    return Finding(check, Level.TROUBLE, said, do)
