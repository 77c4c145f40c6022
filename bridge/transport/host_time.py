"""Receive times on a steady clock, which is not affected when the host's clock is set.

Setting the host's clock must not move samples or lengthen a silence, so all receive times use the steady clock.
Published times are converted to the host's clock as it is set at that moment.
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
    """Return the time of a steady clock, ns since the Unix epoch.

    The time equals that of the host's clock when this program started, and is not affected when the host's clock is set
    afterwards.
    """
    return _steady_ns() + _AHEAD_NS


def set_ns(before_ns: int = 0) -> int:
    """Return how far the host's clock has been set forward since the program's start, ns; negative if set back.

    before_ns: result of the previous call, ns. It is returned again if the new result differs by less than 1 ms.
    """
    by_ns = _ahead_ns() - _AHEAD_NS
    return by_ns if abs(by_ns - before_ns) >= _NOISE_NS else before_ns
