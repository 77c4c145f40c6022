"""Which finished recordings have expired, by age and by total size. Pure: the files and the time are arguments."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple


class Finished(NamedTuple):
    """A finished recording.

    bytes: size of the file. ended_ns: when it was last written, host time, ns since the Unix epoch.
    """

    path: Path
    bytes: int
    ended_ns: int


def expired(
    finished: Sequence[Finished], more_bytes: int, now_ns: int, keep_s: float, keep_bytes: float
) -> Iterator[tuple[Finished, str]]:
    """Yield the recordings to delete, each with the setting that demands it: keep_days or keep_gb.

    finished: oldest first. more_bytes: size of the recording under way, which counts and is never deleted.
    now_ns: host time, ns since the Unix epoch. keep_s: longest age, s. keep_bytes: largest size of all together.
    """
    left = more_bytes + sum(one.bytes for one in finished)
    for one in finished:
        too_old = now_ns - one.ended_ns > keep_s * 1e9
        if not too_old and left <= keep_bytes:
            return
        left -= one.bytes
        yield one, "keep_days" if too_old else "keep_gb"
