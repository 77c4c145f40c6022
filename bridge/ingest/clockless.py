"""Time for a device that tells none: its samples are counted, and their period is what the clock fit measures.

Two things a device's own clock would have told: how long a sample is, and that some are missing. The first follows the
fit from the rate that was promised on, and never jumps. The second is told by the arrivals: after a silence either what
was held up comes in a burst, or all that follows stays late by the samples that are missing.
"""

from math import inf

import numpy as np

from bridge.drivers.driver import Readings
from bridge.ingest.counters import Counts

TICK_S = 1e-6  # of the time that is made
_FEW = 4  # periods: a shorter silence is not told from an unsteady link
_LEAST_S = 0.05
_DOUBT_S = 0.5  # by then a burst has caught up, or gained something
_LONGEST_DOUBT_S = 5.0


class MadeTime:
    """Ticks of TICK_S that rise with the count of samples, by the period as it was last known."""

    def __init__(self) -> None:
        self._at: tuple[int, float] | None = None  # the latest count, and its ticks

    def ticks(self, counts: Counts, period_s: float) -> Counts:
        """(n,) the ticks of rising counts (n,), those of a call above those of all before."""
        step = period_s / TICK_S
        count, ticks = self._at or (int(counts[0]), int(counts[0]) * step)
        rising = ticks + (counts - count) * step
        self._at = int(counts[-1]), float(rising[-1])
        return np.asarray(np.rint(rising), np.int64)


class Silences:
    """Holds what comes after a silence until it is known whether samples are missing; pure, times are arguments.

    missing: how many are, in all, before what was given out last.
    """

    def __init__(self) -> None:
        self.missing = 0
        self._held: list[Readings] = []
        self._began_ns = self._gained_ns = self._heard_ns = 0
        self._least_s, self._period_s = inf, 0.0

    def take(self, readings: Readings, late_s: float, period_s: float) -> list[Readings]:
        """What may go on, in order; late_s: how much later its last sample came than by the clock it should have."""
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
        """What is held: it has not caught up, and is after a gap."""
        held, self._held = self._held, []
        if held:
            self.missing += round(self._least_s / self._period_s)
        return held
