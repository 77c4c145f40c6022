"""Chooses one of several named streams of a file, or one of several boots."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from bridge.recording.error import RecordingError
from bridge.terminal.plurals import count

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


def choose_boot(path: Path, samples: Sequence[int], boot: int | None, of: str) -> int:
    """Return the index of the boot named by --boot, or of the only one. Raises RecordingError, which lists the boots.

    samples: number of samples of each boot. boot: from 1; None if not given. of: the device, for messages.
    """
    if boot is None and len(samples) > 1:
        said = ", ".join(f"{at} ({count(n, 'sample')})" for at, n in enumerate(samples, 1))
        raise RecordingError(f"{path}: {len(samples)} boots of {of}; choose one with --boot: {said}")
    at = 1 if boot is None else boot
    if not 1 <= at <= len(samples):
        raise RecordingError(f"{path}: no --boot {at} of {of}: give 1 to {len(samples)}")
    if samples[at - 1] < 2:
        raise RecordingError(f"{path}: {count(samples[at - 1], 'sample')} of {of}; at least 2 are needed")
    return at - 1
