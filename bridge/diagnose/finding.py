"""Finding: the result of one check of `truerate doctor`, with severity and advice."""

from dataclasses import dataclass
from enum import Enum


class Level(Enum):
    """Severity of a finding: OK; WARNING, works now but may fail; TROUBLE, does not work."""

    OK = "ok"
    WARNING = "warning"
    TROUBLE = "trouble"


@dataclass(frozen=True, slots=True)
class Finding:
    """Result of one check: name of the check, severity, observation (`said`), and advice (`do`, "" if the level is OK)."""

    check: str
    level: Level
    said: str
    do: str = ""


def ok(check: str, said: str) -> Finding:
    """Create a finding of level OK. check: name of the check. said: observation in words."""
    return Finding(check, Level.OK, said)


def warning(check: str, said: str, do: str) -> Finding:
    """Create a finding of level WARNING: works now but may fail.

    check: name of the check. said: observation in words. do: advice.
    """
    return Finding(check, Level.WARNING, said, do)


def trouble(check: str, said: str, do: str) -> Finding:
    """Create a finding of level TROUBLE: does not work.

    check: name of the check. said: observation in words. do: advice.
    """
    return Finding(check, Level.TROUBLE, said, do)
