"""Exactly once: which samples of a stream are new, by boot and sequence number. What is not new is counted."""

from collections import deque

from bridge.wire.messages import SampleBatch
from bridge.wire.refusal import Reason, Tally


class Sequence:
    """Follows one device. `dropped` counts samples, `events` counts gaps and the samples missing in them."""

    def __init__(self) -> None:
        self.boot: int | None = None
        self.samples_in = self.samples_out = 0
        self.dropped, self.events = Tally(), Tally()
        self._past: deque[int] = deque(maxlen=64)
        self._next: int | None = None
        self._first = 0

    def is_new_boot(self, boot: int) -> bool:
        """Whether samples of this boot mean that the device has started anew."""
        return boot != self.boot and boot not in self._past

    def begin(self, boot: int) -> None:
        """A new boot: what still comes of the old one is late."""
        if self.boot is not None:
            self._past.append(self.boot)
        self.boot = boot
        self._next = None

    def fresh(self, batch: SampleBatch) -> int:
        """How many samples at the start of the batch are not to be used; len(batch) when none is."""
        n = len(batch)
        self.samples_in += n
        if batch.boot != self.boot:
            self.dropped.add(Reason.OLD_BOOT, n)
            return n
        if self._next is None:
            self._next = self._first = batch.sequence
        known = max(0, min(self._next - batch.sequence, n))
        if batch.sequence > self._next:
            self.events.add("gaps")
            self.events.add("missing_samples", batch.sequence - self._next)
        if known:
            self.dropped.add(Reason.DUPLICATE, known)
        self._next = max(self._next, batch.sequence + n)
        self.samples_out += n - known
        return known

    @property
    def seen(self) -> int:
        """Samples the device has made in this boot since it was first heard."""
        return 0 if self._next is None else self._next - self._first
