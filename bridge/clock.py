"""A device's clock against the host's: host = offset + rate * device, from the times at which batches came in.

Bytes come late, never early, and in bursts; so of each second of device time only the batch that was least late counts,
and a robust line (Theil and Sen's median of slopes) goes through those of the last minute.
"""

from collections import deque

import numpy as np

_BINS = 60
_FIRST_FIT = 3  # bins
_TRUSTED_FIT = 10  # bins before a rate near 1 is told from 1
_NEAR_ONE = 0.05  # a real clock is within 0.02 % of the host's; anything beyond this is a replay
_SLOWEST = 1e-4
_STEP_S = 0.25
_BINS_TO_BELIEVE = 6


class ClockFit:
    """The clock of one boot. Usable from the first batch on, with rate 1; pure: all times are arguments.

    rate: host seconds per device second. A host clock that is set back is followed at once, one that is set forward (or
    delays that have come to stay) after some seconds.
    """

    def __init__(self) -> None:
        self.rate = 1.0
        self._zero_ns: int | None = None  # all host times below are seconds since then
        self._offset_s = 0.0
        self._bins: deque[tuple[float, float]] = deque(maxlen=_BINS)  # closed bins: (device, host) least late
        self._number = 0
        self._best: tuple[float, float] | None = None  # of the open bin
        self._late = 0  # closed bins in a row that were much later than foreseen

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
        self._late = self._late + 1 if len(self._bins) >= _TRUSTED_FIT and late_s > _STEP_S else 0
        if self._late >= _BINS_TO_BELIEVE:
            self._restart()
        self._bins.append(best)
        if len(self._bins) >= _FIRST_FIT:
            self._fit()

    def _fit(self) -> None:
        device, host = np.array(self._bins).T
        first, second = np.triu_indices(len(device), 1)
        rate = float(np.median((host[second] - host[first]) / (device[second] - device[first])))
        if len(self._bins) < _TRUSTED_FIT and abs(rate - 1) < _NEAR_ONE:
            rate = 1.0
        if _SLOWEST <= rate <= 1 / _SLOWEST:
            self.rate = rate
        self._offset_s = float(np.median(host - self.rate * device))
