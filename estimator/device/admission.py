"""Admission and reordering of messages: duplicates, boots, leaps, bridges and gaps.

Pure; `now` is seconds of a steady clock.
"""

from bisect import insort
from typing import NamedTuple

from bridge.wire.refusal import Reason
from estimator.device.bridge_choice import BEGINS, BridgeChoice, Ruling
from estimator.device.sequence_numbers import SequenceNumbers
from estimator.samples.sample_buffer import Samples

#: s that missing samples are waited for, and how many samples are held meanwhile
WAIT_S, WINDOW = 0.1, 1024


class _Held(NamedTuple):
    sequence: int
    order: int
    batch: Samples
    came_s: float


class EarlyBatches:
    """Early batches of one boot: they wait until the missing samples arrive, or are overdue.

    Repeated samples pass through: `SequenceNumbers` counts them. `held` is sorted by sequence number; the buffer is
    truthy while it holds anything. begins: first sequence number of the boot, if known.
    """

    def __init__(self, begins: int | None = None) -> None:
        self._begins = begins or 0
        self.held: list[_Held] = []
        #: number of samples held
        self.samples = 0
        self._came = 0

    def __bool__(self) -> bool:
        return bool(self.held)

    def feed(self, batch: Samples, awaited: int | None, now: float) -> list[Samples]:
        """Add a batch; return the batches now in turn. awaited: next sequence number, None before the boot's first sample."""
        awaited = self._begins if awaited is None else awaited
        if batch.sequence <= awaited:
            return [batch, *self._in_turn(max(awaited, batch.sequence + batch.n))]
        self._came += 1
        insort(self.held, _Held(batch.sequence, self._came, batch, now))
        self.samples += batch.n
        return self._up_to(0) if self.samples > WINDOW else []

    def overdue(self, now: float) -> list[Samples]:
        """Batches held for WAIT_S, all before them, and those that follow without a gap."""
        late = [n for n, held in enumerate(self.held) if now - held.came_s >= WAIT_S]
        return self._up_to(late[-1]) if late else []

    def drop(self) -> list[Samples]:
        """All held batches, whatever is missing before them; the buffer is empty afterwards."""
        return self._up_to(len(self.held) - 1) if self.held else []

    def _up_to(self, last: int) -> list[Samples]:
        """Release the held batches up to index `last`, and those that follow without a gap."""
        given = [held.batch for held in self.held[: last + 1]]
        del self.held[: last + 1]
        self.samples -= sum(batch.n for batch in given)
        return given + self._in_turn(max(batch.sequence + batch.n for batch in given))

    def _in_turn(self, awaited: int) -> list[Samples]:
        n = 0
        while n < len(self.held) and self.held[n].sequence <= awaited:
            awaited = max(awaited, self.held[n].sequence + self.held[n].batch.n)
            n += 1
        given = [held.batch for held in self.held[:n]]
        del self.held[:n]
        self.samples -= sum(batch.n for batch in given)
        return given


class Admission:
    """Admission of one device's messages: `judge` each, begin a boot if the ruling says so, then take those `in_order`.

    sequence: counters of accepted samples, shared with the session.
    """

    def __init__(self, silence_s: float) -> None:
        self.source, self.sequence = BridgeChoice(silence_s), SequenceNumbers()
        #: messages that wait for missing samples before them
        self.waiting = EarlyBatches()
        #: boot of the latest samples refused as old, and when they came, s
        self.outdated = 0, float("-inf")
        #: of a failed session: boot, next sequence number, and receive time of its last samples, ns
        self._came_to = 0, 0, 0

    def begin_at(self, sequence: int) -> None:
        """Set the boot's first sequence number: no sample before it is waited for."""
        self.waiting = EarlyBatches(sequence)

    def go_on(self, sequence: int, heard_ns: int) -> None:
        """Continue a boot at this sequence number; other boots' samples received before heard_ns count as earlier boots'."""
        self.begin_at(sequence)
        self.source.go_on(heard_ns)

    def judge(self, batch: Samples, now: float) -> tuple[Ruling, list[Samples]]:
        """Rule on a batch and count it where refused; also returns the held batches that come before it."""
        sequence = self.sequence
        if sequence.boot is None and self._known(batch):
            sequence.refuse(batch, Reason.DUPLICATE)
            return Ruling.LATE, []
        ruling = self.source.judge(batch, sequence, now)
        if ruling is Ruling.LATE:
            self.outdated = batch.boot, now
            sequence.fresh(batch)  # counts the batch
        elif ruling is Ruling.RANGE:
            sequence.refuse(batch, Reason.RANGE)
        elif ruling is Ruling.JUMP:
            released = self.waiting.drop()
            sequence.jump(batch)
            return ruling, released
        elif ruling in BEGINS:
            for late in self.waiting.drop():
                sequence.refuse(late, Reason.OLD_BOOT)
            if sequence.boot is not None:
                self.waiting = EarlyBatches()  # the first number of the new boot is not known
        return ruling, []

    def in_order(self, batch: Samples, now: float) -> list[Samples]:
        """Batches that are in turn now that this one has come."""
        if not self.waiting.held and batch.sequence == self.sequence.next:
            return [batch]
        return self.waiting.feed(batch, self.sequence.next, now)

    def leave(self, reason: str) -> None:
        """Refuse all waiting batches, counted under `reason`."""
        for late in self.waiting.drop():
            self.sequence.refuse(late, reason)

    def restart(self, came: int, out: int, last_ns: int) -> SequenceNumbers:
        """Counters for a new session after one has failed; see `SequenceNumbers.anew`. Waiting batches are dropped.

        last_ns: receive time of the last samples the failed session took, ns.
        """
        before = self.sequence
        self.waiting = EarlyBatches(before.next or 0)
        if before.boot is not None:
            self._came_to = before.boot, before.next or 0, last_ns
        self.sequence = before.anew(came, out)
        return self.sequence

    def _known(self, batch: Samples) -> bool:
        """Whether a failed session had already taken all samples of a batch."""
        boot, following, received_ns = self._came_to
        return batch.boot == boot and batch.sequence + batch.n <= following and batch.receive_time_ns <= received_ns
