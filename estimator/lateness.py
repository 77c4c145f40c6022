"""Whether a batch comes late: much longer under way than the others of its device lately. Pure; times are seconds of wall clocks.

The clocks of a bridge's machine and of ours need not agree: how far they are apart is the least that samples took for a minute.
"""

from dataclasses import dataclass, replace

import numpy as np

from bridge.wire.messages import CorrectedBatch, SampleFlag

#: as a bridge has it
LATE_S = 1.0
#: clocks agree as far as this, until a minute has shown otherwise; further apart, what comes is of another time, a recording's
_AGREE_S = 60.0
_KNOWN_S = 60.0


@dataclass(slots=True)
class _Way:
    least_s: float
    before_s: float
    since_s: float


class Lateness:
    """Of a bounded number of devices."""

    def __init__(self, devices: int = 4096) -> None:
        self._room = devices
        self._ways: dict[str, _Way] = {}

    def marked(self, batch: CorrectedBatch, now: float) -> CorrectedBatch:
        """The batch that came at `now`; those of its samples flagged that are late."""
        lasts_s = int(batch.ticks[-1] - batch.ticks[0]) * batch.tick_period_s * batch.clock_rate
        took_s = now - batch.start_time_ns / 1e9 - lasts_s
        way = self._ways.get(batch.device)
        if way is None:
            while len(self._ways) >= self._room:
                del self._ways[next(iter(self._ways))]
            clocks_s = 0.0 if abs(took_s) <= _AGREE_S else took_s
            way = self._ways[batch.device] = _Way(clocks_s, clocks_s, now)
        if not 0.0 <= now - way.since_s <= _KNOWN_S:
            way.before_s, way.least_s, way.since_s = way.least_s, took_s, now
        way.least_s = min(way.least_s, took_s)
        over_s = took_s - min(way.least_s, way.before_s) - LATE_S
        if over_s + lasts_s <= 0.0:
            return batch
        # In a long batch the first samples may be late and the last not.
        earlier_s = (batch.ticks[-1] - batch.ticks).astype(np.float64) * (batch.tick_period_s * batch.clock_rate)
        late = np.where(over_s + earlier_s > 0.0, np.uint32(SampleFlag.LATE), np.uint32(0))
        return replace(batch, flags=batch.flags | late)
