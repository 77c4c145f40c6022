"""A device's clock against the host's: host = offset + rate * device, from the times at which batches came in.

Bytes come late, never early, and in bursts; so of each second of device time only the batch that was least late counts,
and a robust line (Theil and Sen's median of slopes) goes through those of the last minute.
"""

from collections import deque
from functools import cache
from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

_BINS = 60
_FIRST_FIT = 3  # bins
_TESTED_FIT = 5  # bins before an interval of the rate can speak against 1: of fewer, chance orders too many
_TRUSTED_FIT = 10  # bins before a rate near 1 is told from 1 though 1 is in its interval
_NEAR_ONE = 0.05  # most clocks are within 0.1 % of the host's; anything beyond this is a replay, or a wrong promise
_VAGUE = 0.1  # of the rate: an interval as wide as this, to either side, says nothing yet
_SURE = 0.005  # of the rate
_SLOWEST = 1e-4
_STEP_S = 0.25
_BINS_TO_BELIEVE = 6


class ClockFit:
    """The clock of one boot. Usable from the first batch on, with rate 1; pure: all times are arguments.

    rate: host seconds per device second; rate_error: half of its interval of 95 %, where lateness is alike at all times;
    infinite until it was measured.
    A host clock that is set back is followed at once, one that is set forward (or delays that have come to stay) after
    some seconds; what only comes late for a while and then catches up moves nothing.
    """

    def __init__(self) -> None:
        self.rate = 1.0
        self.rate_error = inf
        self._zero_ns: int | None = None  # all host times below are seconds since then
        self._offset_s = 0.0
        self._bins: deque[tuple[float, float]] = deque(maxlen=_BINS)  # closed bins: (device, host) least late
        self._number = 0
        self._best: tuple[float, float] | None = None  # of the open bin
        self._late = 0  # closed bins in a row that were much later than foreseen
        self._late_s = 0.0  # how much, the latest

    @property
    def measured(self) -> bool:
        """Whether `rate` is more than a promise."""
        return self.rate_error < inf

    @property
    def sure(self) -> bool:
        """Whether a sample's lateness can be told from an error of the rate."""
        return self.rate_error < _SURE * self.rate

    def observe(self, device_s: float, receive_time_ns: int) -> None:
        """A batch whose last sample was taken at device_s came in at receive_time_ns; device_s never goes back."""
        number = int(device_s // 1)
        if self._zero_ns is None:
            self._zero_ns, self._number = receive_time_ns, number
        host_s = (receive_time_ns - self._zero_ns) * 1e-9
        early_s = self._expected(device_s) - host_s
        if len(self._bins) >= _FIRST_FIT and early_s > _STEP_S * max(1.0, self.rate):
            self._restart()  # earlier than can be: the host's clock was set back
        if self._best is not None and number != self._number:
            self._close_bin()
        self._number = number
        if self._best is None or host_s - self.rate * device_s < self._best[1] - self.rate * self._best[0]:
            self._best = (device_s, host_s)
            if not self._bins:
                self._offset_s = host_s - self.rate * device_s

    def host_ns(self, device_s: float) -> int:
        """The host time of device_s, ns since the Unix epoch; 0 before the first observation."""
        if self._zero_ns is None:
            return 0
        return self._zero_ns + round(self._expected(device_s) * 1e9)

    def _expected(self, device_s: float) -> float:
        return self._offset_s + self.rate * device_s

    def _restart(self) -> None:
        """Keep the rate, forget the offset."""
        self._bins.clear()
        self._best = None
        self._late = 0

    def _close_bin(self) -> None:
        best, self._best = self._best, None
        if best is None:
            return
        late_s = best[1] - self._expected(best[0])
        if len(self._bins) >= _TRUSTED_FIT and late_s > _STEP_S:
            catching_up = late_s < self._late_s - _STEP_S
            self._late = 1 if catching_up else self._late + 1
            self._late_s = late_s
            if self._late < _BINS_TO_BELIEVE:
                return
            self._restart()
        self._late, self._late_s = 0, 0.0
        self._bins.append(best)
        if len(self._bins) >= _FIRST_FIT:
            self._fit()

    def _fit(self) -> None:
        device, host = np.array(self._bins).T
        low, rate, high = _slope(device, host)
        error = (high - low) / 2
        if _SLOWEST <= rate <= 1 / _SLOWEST and error < _VAGUE * rate:
            n, near = len(device), abs(rate - 1) < _NEAR_ONE
            as_promised = near and (n < _TESTED_FIT or (n < _TRUSTED_FIT and low <= 1 <= high))
            self.rate = 1.0 if as_promised else rate
            self.rate_error = inf if near and n < _TESTED_FIT else error + abs(rate - self.rate)
        self._offset_s = _median(np.sort(host - self.rate * device))


def _slope(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[float, float, float]:
    """Theil and Sen's slope of points (n,), n > 2, between the ends of its 95 % interval (Sen, JASA 63, 1968, eq. 2.6)."""
    first, second = _pairs(len(x))
    slopes = np.sort((y[second] - y[first]) / (x[second] - x[first]))
    n, of = len(x), len(slopes)
    half = 1.96 * sqrt(n * (n - 1) * (2 * n + 5) / 18) / 2
    low, high = max(0, round(of / 2 - half)), min(of - 1, round(of / 2 + half))
    return float(slopes[low]), _median(slopes), float(slopes[high])


@cache  # of at most _BINS points, by each device each second
def _pairs(n: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    return np.triu_indices(n, 1)


def _median(rising: NDArray[np.float64]) -> float:
    """Of sorted numbers, which np.median would sort again."""
    middle = len(rising) // 2
    return float(rising[middle] if len(rising) % 2 else (rising[middle - 1] + rising[middle]) / 2)
