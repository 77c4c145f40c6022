"""Reorder buffer of a subscriber: delivers each sample once and in order, by device, boot and sequence number. Pure.

A batch that arrives early is held until the samples before it arrive, for a bounded time. After that time the absent
samples are reported as missing. If several estimators publish a sample, the one with the highest epoch is delivered.
An epoch is the number of a period in which one estimator owns a device: it alone processes the device's samples.

A sample with an older epoch than the last delivered sample waits for HANDOVER_S, since the present owner may still
publish it. Therefore an estimator that resumes after a hang is ignored while another estimator owns its device. If no
other estimator owns the device, no sample is lost.
"""

from bisect import bisect_left
from collections import OrderedDict, deque
from dataclasses import dataclass, field, replace
from math import inf
from typing import NamedTuple

from bridge.wire.messages import CorrectedBatch, SampleFlag
from estimator.client.revision import SAME_TIME_NS

#: how long to wait for a hole: two publishers may overtake each other by some batches, s
WAIT_S = 0.1
#: shortest wait where the epoch changes, s: a former owner is heard again within 2 s after a network cut ends, and
#: another estimator takes over a hung estimator's device within 3 s
HANDOVER_S = 3.0
#: most samples held per boot; a longer wait raises the limit to what the fastest device sends in that time
WINDOW, FASTEST_HZ = 4096, 1000.0
#: most boots remembered; beyond that the boot heard longest ago is forgotten
BOOTS = 16384
#: a bridge that just started or was paused may date samples later than they were, by up to this much
MISTAKEN_NS = 30_000_000_000


@dataclass(frozen=True, slots=True)
class Miss:
    """Report of a gap: `count` samples of a device's boot, from sequence number `first` on, did not arrive.

    boot: 64-bit boot number. told: True if the sample after the gap has the flag AFTER_GAP.
    """

    device: str
    boot: int
    first: int
    count: int
    told: bool


class _Held(NamedTuple):
    first: int  # its sequence number
    batch: CorrectedBatch
    due_s: float  # latest delivery time


@dataclass(slots=True, eq=False)
class _Boot:
    next: int | None  # sequence number to deliver next; None: the lowest that arrives within the wait
    latest: CorrectedBatch  # last delivered
    newest_ns: int = (
        0  # latest start of a delivered batch: later than that of `latest` once the bridge's clock was set back
    )
    held: list[_Held] = field(default_factory=list)  # sorted by sequence number, disjoint
    samples: int = 0  # total in `held`


class ReorderBuffer:
    """Reorder buffer: takes batches in any order, and puts batches and reports of gaps into `ready` in delivery order.

    wait_s: time to wait for missing samples. boots: largest number of boots, of all devices, whose state is
    kept.
    repeated: number of samples left out because they were duplicates, or arrived after being reported as missing.
    missing: number of samples reported as missing, by device.
    """

    def __init__(self, wait_s: float = WAIT_S, boots: int = BOOTS) -> None:
        self.ready: deque[CorrectedBatch | Miss] = deque()
        self.repeated = 0
        self.missing: dict[str, int] = {}
        self._wait_s, self._window, self._most = wait_s, max(WINDOW, round(wait_s * FASTEST_HZ)), boots
        self._boots: OrderedDict[tuple[str, int], _Boot] = OrderedDict()
        self._waiting: dict[_Boot, None] = {}  # in the order in which they began to wait

    def feed(self, batch: CorrectedBatch, now: float) -> None:
        """Add a received batch; put into `ready` all batches that can be delivered now.

        now: time of a steady clock, s. A batch that arrives before its predecessors is held until they arrive, or until
        `overdue` ends its wait.
        """
        boot, n = self._boot(batch), len(batch)
        if batch.sequence == boot.next and not boot.held and batch.epoch >= boot.latest.epoch:
            self._deliver(boot, batch)
            return
        if _begins_anew(batch, boot.held[-1].batch if boot.held else boot.latest, boot.newest_ns):
            self._advance(boot, len(boot.held))
            boot.next, boot.latest = None if batch.sequence else 0, batch
        known = 0 if boot.next is None else min(n, max(0, boot.next - batch.sequence))
        self.repeated += known
        if known == n:
            return
        same = batch.epoch == boot.latest.epoch or (boot.next is None and batch.epoch > boot.latest.epoch)
        due_s = now + (self._wait_s if same else max(self._wait_s, HANDOVER_S))
        self._hold(boot, batch.after(known) if known else batch, due_s)
        self._advance(boot)
        while boot.samples > self._window:
            self._advance(boot, 1)

    def due(self) -> float:
        """Return the earliest time at which the wait of a held batch ends, s of the steady clock.

        The result is inf if no batch is held.
        """
        return min((held.due_s for boot in self._waiting for held in boot.held), default=inf)

    def overdue(self, now: float) -> None:
        """Deliver held batches whose wait has ended, and report the samples missing before them.

        now: time of the steady clock, s; inf delivers every held batch.
        """
        for boot in list(self._waiting):
            waited = [n for n, held in enumerate(boot.held, 1) if held.due_s <= now]
            if waited:
                self._advance(boot, waited[-1])

    def _boot(self, batch: CorrectedBatch) -> _Boot:
        """Find or create the record of a batch's boot, and mark it as most recently heard."""
        which = batch.device, batch.boot
        boot = self._boots.get(which)
        if boot is None:
            boot = self._boots[which] = _Boot(None if batch.sequence else 0, batch)
            if len(self._boots) > self._most:
                (device, _), oldest = self._boots.popitem(last=False)
                self._advance(oldest, len(oldest.held))
                self.missing.pop(device, None)
        self._boots.move_to_end(which)
        return boot

    def _hold(self, boot: _Boot, batch: CorrectedBatch, due_s: float) -> None:
        """Insert a batch among the held ones; of duplicate samples keep those with the higher epoch."""
        at, to = (bisect_left(boot.held, (number,)) for number in (batch.sequence, batch.sequence + len(batch)))
        if at and boot.held[at - 1].first + len(boot.held[at - 1].batch) > batch.sequence:
            at -= 1
        kept, pieces, before = list[_Held](), [batch], boot.held[at:to]
        for held in before:
            if held.batch.epoch < batch.epoch:
                kept += [_Held(piece.sequence, piece, held.due_s) for piece in _outside(held.batch, batch)]
            else:
                kept.append(held)
                pieces = [rest for piece in pieces for rest in _outside(piece, held.batch)]
        kept += [_Held(piece.sequence, piece, due_s) for piece in pieces]
        boot.held[at:to] = sorted(kept)
        more = sum(len(held.batch) for held in kept) - sum(len(held.batch) for held in before)
        boot.samples += more
        self.repeated += len(batch) - more

    def _deliver(self, boot: _Boot, batch: CorrectedBatch) -> None:
        boot.next, boot.latest = batch.sequence + len(batch), batch
        boot.newest_ns = max(boot.newest_ns, batch.start_time_ns)
        self.ready.append(batch)

    def _advance(self, boot: _Boot, through: int = 0) -> None:
        """Deliver the first `through` held batches with reports of holes, then every batch that follows in sequence."""
        n = 0
        for _, batch, _ in boot.held:
            in_turn = batch.sequence == boot.next and batch.epoch >= boot.latest.epoch
            if n >= through and not in_turn:
                break
            if boot.next is not None and batch.sequence > boot.next:
                count, told = batch.sequence - boot.next, bool(batch.flags[0] & SampleFlag.AFTER_GAP)
                self.missing[batch.device] = self.missing.get(batch.device, 0) + count
                self.ready.append(Miss(batch.device, batch.boot, boot.next, count, told))
            boot.samples -= len(batch)
            self._deliver(boot, batch)
            n += 1
        del boot.held[:n]
        if boot.held:
            self._waiting.setdefault(boot)
        else:
            self._waiting.pop(boot, None)


def _begins_anew(batch: CorrectedBatch, newest: CorrectedBatch, newest_ns: int) -> bool:
    """Return whether low sequence numbers mean a device restarted under its old boot number, not repeated samples.

    newest: batch with the highest sequence numbers so far. newest_ns: latest start of a delivered batch, ns since the
    Unix epoch.
    """
    by_ns = SAME_TIME_NS if batch.epoch == newest.epoch else MISTAKEN_NS
    if (
        batch.sequence + len(batch) > newest.sequence + len(newest)
        or batch.start_time_ns - max(newest_ns, newest.start_time_ns) <= by_ns
    ):
        return False
    return batch.start_time_ns - int(newest.sample_time_ns[-1]) > by_ns


def _outside(batch: CorrectedBatch, other: CorrectedBatch) -> list[CorrectedBatch]:
    """The parts of a batch before the first and after the last sample of another batch."""
    first, last = batch.sequence, batch.sequence + len(batch)
    start, end = other.sequence, other.sequence + len(other)
    return [_cut(batch, a - first, b - first) for a, b in ((first, min(last, start)), (max(first, end), last)) if a < b]


def _cut(batch: CorrectedBatch, start: int, end: int) -> CorrectedBatch:
    """Samples `start` to `end` (exclusive) of a batch."""
    rest = batch.after(start) if start else batch
    n = end - start
    return rest if n == len(rest) else replace(rest, ticks=rest.ticks[:n], rate=rest.rate[:n], flags=rest.flags[:n])
