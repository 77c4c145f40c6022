"""Sample times and gaps of a device without a clock, derived from its sample count and from arrival times.

The sample period begins with that of the nominal rate. Later it comes from the clock fit: a line fitted to sample
counts and receive times (`clock_fit`). Sample times do not jump when the period changes. After a silence, samples are
either delayed or missing. Delayed samples arrive in a burst, and later samples are on time again. If samples are
missing, all later samples stay late by the duration of the missing ones.
"""

from math import inf

import numpy as np

from bridge.drivers.driver import Readings
from bridge.ingest.counter_unwrapping import Counts

TICK_S = 1e-6  # of the derived sample time
_FEW = 4  # periods; a shorter silence cannot be told from an unsteady link
_LEAST_S = 0.05
_DOUBT_S = 0.5  # by then, delayed samples have arrived in a burst
_LONGEST_DOUBT_S = 5.0


class ArrivalClock:
    """Derives sample times in ticks of TICK_S seconds (1 µs) for a device without a clock, from sample counts and period."""

    def __init__(self) -> None:
        self._at: tuple[int, float] | None = None  # latest count, and its ticks

    def ticks(self, counts: Counts, period_s: float) -> Counts:
        """Return the times (n,) int64 of samples, in ticks of TICK_S seconds (1 µs); they keep rising from call to call.

        counts (n,): sample counts, rising. period_s: latest estimate of the sample period, s of host time.
        """
        step = period_s / TICK_S
        count, ticks = self._at or (int(counts[0]), int(counts[0]) * step)
        rising = ticks + (counts - count) * step
        self._at = int(counts[-1]), float(rising[-1])
        return np.asarray(np.rint(rising), np.int64)


class SilenceDetector:
    """Detects samples missing after a silence of a device without a clock. No I/O; times are arguments.

    Readings after a silence are held until it is known if samples are missing or only delayed.
    missing: number of samples counted as missing since the boot began.
    """

    def __init__(self) -> None:
        self.missing = 0
        self._held: list[Readings] = []
        self._began_ns = self._gained_ns = self._heard_ns = 0
        self._least_s, self._period_s = inf, 0.0

    def take(self, readings: Readings, late_s: float, period_s: float) -> list[Readings]:
        """Add new readings; return the readings, new and held, that may be published now, in order.

        late_s: how much later the last new sample was received than the clock fit predicts, s. period_s: sample period,
        s of host time.
        Method: limit = max(0.05 s, 4 periods). Readings are held if the silence before them and their lateness both
        reach the limit. If the lateness then falls below the limit, the samples were only delayed.
        The samples count as missing if the lateness has not decreased by more than the limit for 0.5 s, or after 5 s.
        The number of missing samples is the smallest lateness divided by the period.
        """
        silent_s, self._heard_ns = (readings.receive_time_ns - self._heard_ns) * 1e-9, readings.receive_time_ns
        limit_s, self._period_s = max(_LEAST_S, _FEW * period_s), period_s
        if not self._held:
            if min(silent_s, late_s) < limit_s:
                return [readings]
            self._began_ns = self._gained_ns = readings.receive_time_ns
            self._least_s = late_s
        self._held.append(readings)
        if late_s < self._least_s - limit_s:
            self._gained_ns = readings.receive_time_ns
        self._least_s = min(self._least_s, late_s)
        since_s, gained_s = ((readings.receive_time_ns - ns) * 1e-9 for ns in (self._began_ns, self._gained_ns))
        if self._least_s < limit_s:
            held, self._held = self._held, []
            return held
        return self.release() if gained_s >= _DOUBT_S or since_s >= _LONGEST_DOUBT_S else []

    def release(self) -> list[Readings]:
        """Return the held readings, [] if none, and add the samples missing before them to `missing`.

        Call it when no more data is expected, so that delayed samples cannot arrive.
        """
        held, self._held = self._held, []
        if held:
            self.missing += round(self._least_s / self._period_s)
        return held
