"""Fit of a device's clock to the host's clock by a robust line: host = offset + rate · device.

Bytes arrive late, never early, and in bursts. So only the least delayed batch of each second of device time is used. A
Theil–Sen line (median of the slopes of all pairs) is fitted to the batches of the last 60 seconds with data.
"""

from collections import deque
from functools import cache
from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

_BINS = 60
_FIRST_FIT = 3  # bins
_TESTED_FIT = 5  # bins before the rate's interval can contradict 1: with fewer bins, chance does so too often
_TRUSTED_FIT = 10  # bins before a rate near 1 is used although its interval includes 1
_NEAR_ONE = 0.05  # most clocks are within 0.1 % of the host's; a larger difference is a replay or a wrong nominal rate
_VAGUE = 0.1  # of the rate: a fit whose interval is wider to either side is not used
_SURE = 0.005  # of the rate
_SLOWEST = 1e-4
_STEP_S = 0.25
_BINS_TO_BELIEVE = 6


class ClockFit:
    """Fits host = offset + rate · device to the clock of one boot. No I/O; times are arguments.

    host, device: times of a sample by the two clocks, s. `rate` is 1 until it has been measured.
    rate: host seconds per device second (no unit).
    rate_error: half the width of the 95 % confidence interval of `rate`, no unit; infinite until measured. It assumes
    that the lateness has the same distribution at all times. The interval of the Theil–Sen slope is that of Sen (JASA
    63, 1968, eq. 2.6).
    If the host's clock is set back, the fit follows at once. If it is set forward, or the delay of all batches grows,
    the fit follows after some seconds. A delay that ends sooner does not change the fit.
    """

    def __init__(self) -> None:
        self.rate = 1.0
        self.rate_error = inf
        self._zero_ns: int | None = None  # origin of all host times below, which are seconds
        self._offset_s = 0.0
        self._bins: deque[tuple[float, float]] = deque(maxlen=_BINS)  # least late (device_s, host_s) of each closed bin
        self._number = 0
        self._best: tuple[float, float] | None = None  # least late of the open bin
        self._late = 0  # consecutive closed bins that were much later than expected
        self._late_s = 0.0  # lateness of the latest closed bin

    @property
    def measured(self) -> bool:
        """True if `rate` has been measured; until then it is assumed to be 1."""
        return self.rate_error < inf

    @property
    def sure(self) -> bool:
        """True if `rate_error` is below 0.5 % of `rate`, so that a sample's lateness can be distinguished from a rate error."""
        return self.rate_error < _SURE * self.rate

    def observe(self, device_s: float, receive_time_ns: int) -> None:
        """Add a batch to the fit, by its last sample.

        device_s: device time of the sample, s, never falling. receive_time_ns: receive time, ns since the Unix epoch.
        """
        number = int(device_s // 1)
        if self._zero_ns is None:
            self._zero_ns, self._number = receive_time_ns, number
        host_s = (receive_time_ns - self._zero_ns) * 1e-9
        early_s = self._expected(device_s) - host_s
        if len(self._bins) >= _FIRST_FIT and early_s > _STEP_S * max(1.0, self.rate):
            self._restart()  # earlier than possible: the host's clock was set back
        if self._best is not None and number != self._number:
            self._close_bin()
        self._number = number
        if self._best is None or host_s - self.rate * device_s < self._best[1] - self.rate * self._best[0]:
            self._best = (device_s, host_s)
            if not self._bins:
                self._offset_s = host_s - self.rate * device_s

    def host_ns(self, device_s: float) -> int:
        """Convert device time device_s (s) to host time, ns since the Unix epoch; 0 before the first observation."""
        if self._zero_ns is None:
            return 0
        return self._zero_ns + round(self._expected(device_s) * 1e9)

    def _expected(self, device_s: float) -> float:
        return self._offset_s + self.rate * device_s

    def _restart(self) -> None:
        """Forget the offset, keep the rate."""
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
    """Theil–Sen slope of points (n,), n > 2, with its 95 % interval (Sen, JASA 63, 1968, eq. 2.6); returns low, slope, high."""
    first, second = _pairs(len(x))
    slopes = np.sort((y[second] - y[first]) / (x[second] - x[first]))
    n, of = len(x), len(slopes)
    half = 1.96 * sqrt(n * (n - 1) * (2 * n + 5) / 18) / 2
    low, high = max(0, round(of / 2 - half)), min(of - 1, round(of / 2 + half))
    return float(slopes[low]), _median(slopes), float(slopes[high])


@cache  # at most _BINS points; called once a second per device
def _pairs(n: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    return np.triu_indices(n, 1)


def _median(rising: NDArray[np.float64]) -> float:
    """Median of sorted numbers; np.median would sort again."""
    middle = len(rising) // 2
    return float(rising[middle] if len(rising) % 2 else (rising[middle - 1] + rising[middle]) / 2)
