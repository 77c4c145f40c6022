"""Receive times of this host, on a clock that continues evenly when the host's clock is set.

Setting the host's clock must not move samples or lengthen a silence, so all receive times use this steady clock.
Published times are converted to the host's clock as it is then set.
"""

import sys
import time
from functools import partial

if sys.platform == "win32":
    _steady_ns = time.monotonic_ns
else:
    # CLOCK_BOOTTIME also counts sleep
    _steady_ns = partial(time.clock_gettime_ns, getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC))

_NOISE_NS = 1_000_000  # between reading two clocks


def _ahead_ns() -> int:
    """How far the host's clock is ahead of the steady clock, ns.

    The maximum of three readings, because a delay between the two reads lowers the result.
    """
    return max(time.time_ns() - _steady_ns() for _ in range(3))


_AHEAD_NS = _ahead_ns()


def now_ns() -> int:
    """Return the time in ns since the Unix epoch, by the host's clock as it was set when this program started.

    This time continues evenly when the host's clock is set.
    """
    return _steady_ns() + _AHEAD_NS


def set_ns(before_ns: int = 0) -> int:
    """Return how far the host's clock has been set forward since the program's start, ns; negative if set back.

    before_ns: the previous result, which is returned again unless the clock was set by 1 ms or more since.
    """
    by_ns = _ahead_ns() - _AHEAD_NS
    return by_ns if abs(by_ns - before_ns) >= _NOISE_NS else before_ns
