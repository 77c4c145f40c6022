"""Which messages of a device are taken, and in which order: duplicates, boots, leaps, bridges and holes are all known here."""

from bridge.wire.refusal import Reason
from estimator.device.reorder_buffer import ReorderBuffer
from estimator.device.samples import Samples
from estimator.device.sequence import Sequence
from estimator.device.source import BEGINS, Ruling, Source


class Admission:
    """One device's messages: `judge` each, begin a boot where that says so, then take what is `in_order`.

    sequence: what was taken, counted; the session counts in it, too.
    """

    def __init__(self, silence_s: float) -> None:
        self.source, self.sequence = Source(silence_s), Sequence()
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

    def restart(self, lost: int, uncounted: int, last_ns: int) -> Sequence:
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
