"""Which finished recordings have expired, by age and by total size. Pure: the files and the time are arguments."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple


class Finished(NamedTuple):
    """A finished recording. ended_ns: when it was last written, host time in ns."""

    path: Path
    bytes: int
    ended_ns: int


def expired(
    finished: Sequence[Finished], more_bytes: int, now_ns: int, keep_s: float, keep_bytes: float
) -> Iterator[tuple[Finished, str]]:
    """Yield the recordings to delete, each with the setting that says so. finished: oldest first.

    more_bytes: size of the recording under way, which counts and is never deleted.
    """
    left = more_bytes + sum(one.bytes for one in finished)
    for one in finished:
        too_old = now_ns - one.ended_ns > keep_s * 1e9
        if not too_old and left <= keep_bytes:
            return
        left -= one.bytes
        yield one, "keep_days" if too_old else "keep_gb"
