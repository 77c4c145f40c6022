"""Chooses one of several named streams of a file."""

from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from bridge.recording.error import RecordingError

T = TypeVar("T")


def choose(path: Path, streams: Mapping[str, T], device: str | None, what: str) -> T:
    """Return the stream named by --device, or the only stream. Raises RecordingError, which lists the names.

    what: a stream in the plural, such as "topics".
    """
    if device is None and len(streams) > 1:
        raise RecordingError(f"{path}: {len(streams)} {what}; choose one with --device: {', '.join(streams)}")
    name = next(iter(streams), "") if device is None else device
    if name not in streams:
        if not streams:
            raise RecordingError(f"{path}: the file has no {what}: give another file")
        raise RecordingError(f"{path}: no samples of --device {name!r}; choose from {', '.join(streams)}")
    return streams[name]
