"""Whether a batch comes late: much longer under way than the others of its device lately, or after what came next.

Pure; times are seconds of wall clocks. Those of a bridge's machine and of ours need not agree: how far they are apart is the
least that samples took for a minute, and one that is set back is known by the device's, at a reboot by more than can be kept.
What came next is a later boot, or a later turn of an estimator at the same boot.
"""

from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np

from bridge.wire.messages import CorrectedBatch, SampleFlag
from estimator.fence import FORGET_S

#: as a bridge has it
LATE_S = 1.0
#: clocks agree as far as this, until a minute has shown otherwise; further apart, what comes is of another time, a recording's.
#: Nothing is kept for longer, either, than since the last that was given
_AGREE_S = 60.0
_KNOWN_S = 60.0
#: a bridge's clock was set back by more than that, s
_SET_S = 0.5
_BOOTS = 8


@dataclass(slots=True)
class _Latest:
    """What was given last of a device; and its boots before that one, as far as is remembered."""

    boot: int
    epoch: int
    given_s: float
    begun_ns: int  # when that boot's first sample that was given was taken
    before: deque[int] = field(default_factory=deque)

    def overtook(self, batch: CorrectedBatch, now: float, *, late: bool) -> bool:
        """Whether a batch that is given `now` is of an earlier boot or turn; if not, it is the latest."""
        other = batch.boot != self.boot
        before = batch.boot in self.before or (other and batch.start_time_ns < self.begun_ns)
        earlier = before or (not other and batch.epoch < self.epoch)
        # Another boot that is late when it is heard may be an old one, from a cache.
        if (other and late) or (earlier and 0.0 <= now - self.given_s < FORGET_S):
            return True
        if other:
            self.begun_ns = batch.start_time_ns
            self.before = deque((b for b in (*self.before, self.boot) if b != batch.boot), maxlen=_BOOTS)
        self.boot, self.epoch, self.given_s = batch.boot, batch.epoch, now
        return False


@dataclass(slots=True)
class _Way:
    least_s: float
    before_s: float
    since_s: float
    latest: _Latest
    #: the last batch, how long that took, and when it came
    batch: CorrectedBatch
    took_s: float
    came_s: float

    def follow(self, batch: CorrectedBatch, took_s: float, now: float) -> None:
        """What a bridge says after its clock was set back, which the device's was not, is not longer under way for that."""
        before, back_s, most_s = self.batch, took_s - self.took_s, now - self.came_s + _AGREE_S
        self.batch, self.took_s, self.came_s = batch, took_s, now
        if before.boot == batch.boot:
            lasted_s = (int(batch.ticks[0]) - int(before.ticks[0])) * batch.tick_period_s * batch.clock_rate
            back_s, most_s = lasted_s - (batch.start_time_ns - before.start_time_ns) / 1e9, _SET_S
        elif batch.epoch < self.latest.epoch or batch.boot in self.latest.before:
            return  # of an old one, from a cache
        if back_s > most_s:
            self.least_s += back_s
            self.before_s += back_s
            self.latest.begun_ns = min(self.latest.begun_ns, batch.start_time_ns)


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
            latest = _Latest(batch.boot, batch.epoch, now, batch.start_time_ns)
            way = self._ways[batch.device] = _Way(clocks_s, clocks_s, now, latest, batch, took_s, now)
        way.follow(batch, took_s, now)
        if not 0.0 <= now - way.since_s <= _KNOWN_S:
            way.before_s, way.least_s, way.since_s = way.least_s, took_s, now
        way.least_s = min(way.least_s, took_s)
        over_s = took_s - min(way.least_s, way.before_s) - LATE_S
        if way.latest.overtook(batch, now, late=over_s > 0.0):
            return replace(batch, flags=batch.flags | np.uint32(SampleFlag.LATE))
        if over_s + lasts_s <= 0.0:
            return batch
        # In a long batch the first samples may be late and the last not.
        earlier_s = (batch.ticks[-1] - batch.ticks).astype(np.float64) * (batch.tick_period_s * batch.clock_rate)
        late = np.where(over_s + earlier_s > 0.0, np.uint32(SampleFlag.LATE), np.uint32(0))
        return replace(batch, flags=batch.flags | late)
