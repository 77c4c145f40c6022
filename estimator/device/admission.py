"""Admission of messages: duplicates, boots, leaps, bridges and gaps; in which order messages are taken.

Pure; `now` is seconds of a steady clock.
"""

from bisect import insort
from typing import NamedTuple

from bridge.wire.refusal import Reason
from estimator.device.bridge_choice import BEGINS, BridgeChoice, Ruling
from estimator.device.sequence_numbers import SequenceNumbers
from estimator.samples.sample_buffer import Samples

#: how long a hole is waited for, and how many samples are held meanwhile
WAIT_S, WINDOW = 0.1, 1024


class _Held(NamedTuple):
    sequence: int
    order: int
    batch: Samples
    came_s: float


class ReorderBuffer:
    """Messages of one boot that came before their turn wait until what is missing before them comes, or is late.

    Repeated samples pass through: `SequenceNumbers` counts them. `held` lies in the order of its numbers; truthy
    while anything is
    held. begins: the number to begin with, if known.
    """

    def __init__(self, begins: int | None = None) -> None:
        self._begins = begins or 0
        self.held: list[_Held] = []
        #: in all that is held
        self.samples = 0
        self._came = 0

    def __bool__(self) -> bool:
        return bool(self.held)

    def feed(self, batch: Samples, awaited: int | None, now: float) -> list[Samples]:
        """Those whose turn it is, when this one comes and number `awaited` is next; None: the boot's first is not known."""
        awaited = self._begins if awaited is None else awaited
        if batch.sequence <= awaited:
            return [batch, *self._in_turn(max(awaited, batch.sequence + batch.n))]
        self._came += 1
        insort(self.held, _Held(batch.sequence, self._came, batch, now))
        self.samples += batch.n
        return self._up_to(0) if self.samples > WINDOW else []

    def overdue(self, now: float) -> list[Samples]:
        """What has been held for WAIT_S, all before it, and what follows without a hole."""
        late = [n for n, held in enumerate(self.held) if now - held.came_s >= WAIT_S]
        return self._up_to(late[-1]) if late else []

    def drop(self) -> list[Samples]:
        """All that is held, whatever is missing before it."""
        return self._up_to(len(self.held) - 1) if self.held else []

    def _up_to(self, last: int) -> list[Samples]:
        """Wait no longer for what is missing before the held one with this place."""
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
    """One device's messages: `judge` each, begin a boot where that says so, then take what is `in_order`.

    sequence: what was taken, counted; the session counts in it, too.
    """

    def __init__(self, silence_s: float) -> None:
        self.source, self.sequence = BridgeChoice(silence_s), SequenceNumbers()
        #: messages that wait for what is missing before them
        self.waiting = ReorderBuffer()
        #: the boot of samples that were refused as old, and when they came
        self.outdated = 0, float("-inf")
        #: of a session that failed: boot, the number that follows what it took, and when the last of that was received
        self._came_to = 0, 0, 0

    def begin_at(self, sequence: int) -> None:
        """The boot of this device is known to begin with this number here: nothing before it is waited for."""
        self.waiting = ReorderBuffer(sequence)

    def go_on(self, sequence: int, heard_ns: int) -> None:
        """A boot goes on with this number here; what was received before heard_ns of other boots is of earlier ones."""
        self.begin_at(sequence)
        self.source.go_on(heard_ns)

    def judge(self, batch: Samples, now: float) -> tuple[Ruling, list[Samples]]:
        """What to do with a batch, counted where it is refused; and held batches whose turn it is before it."""
        sequence = self.sequence
        if sequence.boot is None and self._known(batch):
            sequence.refuse(batch, Reason.DUPLICATE)
            return Ruling.LATE, []
        ruling = self.source.judge(batch, sequence, now)
        if ruling is Ruling.LATE:
            self.outdated = batch.boot, now
            sequence.fresh(batch)  # which counts it
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
                self.waiting = ReorderBuffer()  # where this one begins is not known
        return ruling, []

    def in_order(self, batch: Samples, now: float) -> list[Samples]:
        """The batches whose turn it is, once this one has come."""
        if not self.waiting.held and batch.sequence == self.sequence.next:
            return [batch]
        return self.waiting.feed(batch, self.sequence.next, now)

    def leave(self, reason: str) -> None:
        """Refuse what waits, for a reason."""
        for late in self.waiting.drop():
            self.sequence.refuse(late, reason)

    def restart(self, lost: int, uncounted: int, last_ns: int) -> SequenceNumbers:
        """The session has failed: the counts of the next one. last_ns: when what it took last was received. See Sequence.anew."""
        before = self.sequence
        self.waiting = ReorderBuffer(before.next or 0)
        if before.boot is not None:
            self._came_to = before.boot, before.next or 0, last_ns
        self.sequence = before.anew(lost, uncounted)
        return self.sequence

    def _known(self, batch: Samples) -> bool:
        """Whether a session that failed had taken in all of a batch."""
        boot, following, received_ns = self._came_to
        return batch.boot == boot and batch.sequence + batch.n <= following and batch.receive_time_ns <= received_ns
