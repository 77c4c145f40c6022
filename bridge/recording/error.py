"""The error raised for a recording that cannot be used."""

from pathlib import Path

from bridge.runtime import os_errors

MAX_BYTES = 1 << 29  # of a file that is read into arrays, and of what it unpacks to


class RecordingError(Exception):
    """A recording cannot be used: the file, what is in it, and what was expected."""


def check_file(path: Path) -> None:
    """Raise RecordingError for a path that cannot be read, without opening it: a pipe would block."""
    if why := os_errors.unreadable(path):
        raise RecordingError(f"{path}: cannot be read: {why}")
