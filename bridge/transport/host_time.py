"""When something came, by this host: a time that goes on where the host's clock is set.

Who sets a clock moves no device and no line: how long a device was silent, and where a sample lies, is told by this. What is
published has the host's clock as it is set by then.
"""

import time

_STEADY = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)  # which goes on in sleep
_NOISE_NS = 1_000_000  # between looking at two clocks


def _ahead_ns() -> int:
    """How much the host's clock is ahead of one that nobody sets; whatever comes between looking at both makes it less."""
    return max(time.time_ns() - time.clock_gettime_ns(_STEADY) for _ in range(3))


_AHEAD_NS = _ahead_ns()


def now_ns() -> int:
    """The time since the Unix epoch by the host's clock as it was when this program began."""
    return time.clock_gettime_ns(_STEADY) + _AHEAD_NS


def set_ns(before_ns: int = 0) -> int:
    """By how much the host's clock was set forward since; before_ns: what that was when it was last asked for."""
    by_ns = _ahead_ns() - _AHEAD_NS
    return by_ns if abs(by_ns - before_ns) >= _NOISE_NS else before_ns
