"""Error for recordings that cannot be used, and a check that a path is readable."""

from pathlib import Path

from bridge.runtime import os_errors

MAX_BYTES = 1 << 29  # limit for a file read into arrays, and for its unpacked size


class RecordingError(Exception):
    """A recording cannot be used, or not be written: the message names the file, the fault, and what to do."""


def check_file(path: Path) -> None:
    """Check that a path can be read. Raises RecordingError if not.

    The path is not opened, because opening a pipe would block.
    """
    if why := os_errors.unreadable(path):
        raise RecordingError(f"{path}: cannot be read: {why}")
