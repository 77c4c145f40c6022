"""Selection of one stream, or of one boot, from a file that has several."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from bridge.recording.error import RecordingError
from bridge.terminal.plurals import count

T = TypeVar("T")


def choose(path: Path, streams: Mapping[str, T], device: str | None, what: str) -> T:
    """Return the stream that --device names, or the only stream.

    device: name of the stream; None if not given. what: plural noun for the streams in messages, such as "topics".
    Raises RecordingError, which lists the names, if no single stream is chosen.
    """
    if device is None and len(streams) > 1:
        raise RecordingError(
            f"{path}: the file has {len(streams)} {what}; choose one with --device: {', '.join(streams)}"
        )
    name = next(iter(streams), "") if device is None else device
    if name not in streams:
        if not streams:
            raise RecordingError(f"{path}: the file has no {what}: give another file")
        raise RecordingError(f"{path}: no samples of --device {name!r}; choose from {', '.join(streams)}")
    return streams[name]


def choose_boot(path: Path, samples: Sequence[int], boot: int | None, of: str) -> int:
    """Return the index, from 0, of the boot that --boot names, or of the only boot.

    samples: number of samples of each boot. boot: number from 1; None if not given. of: the device, for messages.
    Raises RecordingError, which lists the boots, if no single boot is chosen, and for a boot of less than 2 samples.
    """
    if boot is None and len(samples) > 1:
        said = ", ".join(f"{at} ({count(n, 'sample')})" for at, n in enumerate(samples, 1))
        raise RecordingError(f"{path}: {of} has {len(samples)} boots; choose one with --boot: {said}")
    at = 1 if boot is None else boot
    if not 1 <= at <= len(samples):
        raise RecordingError(f"{path}: {of} has no boot {at}: give --boot 1 to {len(samples)}")
    if samples[at - 1] < 2:
        raise RecordingError(f"{path}: boot {at} of {of} has {count(samples[at - 1], 'sample')}; at least 2 are needed")
    return at - 1
