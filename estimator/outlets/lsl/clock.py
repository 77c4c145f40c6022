"""Maps host times to LSL's clock: seconds on a clock of this machine that is never set."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from bridge.transport import host_time


class LslClock:
    """Mapping from host time (ns since the Unix epoch) to LSL's clock (s).

    local_clock: returns the present time of LSL's clock, s.
    The host's clock may be set while the program runs. Sample times follow it, LSL's clock does not.
    """

    def __init__(self, local_clock: Callable[[], float]) -> None:
        # A delay between the two readings lowers the result, so the highest is the best.
        self._ahead_ns = max(host_time.now_ns() - round(local_clock() * 1e9) for _ in range(10))
        self._set_ns = host_time.set_ns()

    def follow(self) -> None:
        """Measure again how far the host's clock has been set; later stamps allow for it."""
        self._set_ns = host_time.set_ns(self._set_ns)

    def stamp(self, time_ns: int) -> float:
        """Convert a host time, in nanoseconds since the Unix epoch, to LSL time in s."""
        return (time_ns - self._set_ns - self._ahead_ns) * 1e-9

    def stamps(self, times_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Convert host times (n,), in nanoseconds since the Unix epoch, to LSL times (n,) in s."""
        return np.asarray((times_ns - (self._set_ns + self._ahead_ns)) * 1e-9, np.float64)
