"""The error for recordings that cannot be used, and a check that a path is readable."""

from pathlib import Path

from bridge.runtime import os_errors

MAX_BYTES = 1 << 29  # limit for a file read into arrays, and for its unpacked size


class RecordingError(Exception):
    """A recording cannot be used: the message names the file, its content, and what was expected."""


def check_file(path: Path) -> None:
    """Raise RecordingError for a path that cannot be read. The path is not opened, because a pipe would block."""
    if why := os_errors.unreadable(path):
        raise RecordingError(f"{path}: cannot be read: {why}")
