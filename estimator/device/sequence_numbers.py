"""Duplicate samples: each sample is taken once, by boot and sequence number; the others are counted."""

from collections.abc import Callable, Iterable

from bridge.wire.refusal import Reason, Tally
from estimator.samples.sample_buffer import Samples

_REMEMBERED_BOOTS = 64


class SequenceNumbers:
    """Follows one device. `dropped` counts samples, `events` counts gaps and the samples missing in them."""

    def __init__(self) -> None:
        self.boot: int | None = None
        self.samples_in = self.samples_out = 0
        self.dropped, self.events = Tally(), Tally()
        self._past: dict[int, int] = {}  # earlier boots, latest last, each with the number it had come to
        self._before: Callable[[], Iterable[int] | None] | None = None
        #: the number that the next sample has; None before the first
        self.next: int | None = None
        self._first = 0

    def is_new_boot(self, boot: int) -> bool:
        """Whether samples of this boot mean that the device has started anew."""
        if boot == self.boot or boot in self._past:
            return False
        before = None if self._before is None else self._before()
        if before is not None:
            self._past, self._before = dict.fromkeys(before, 0) | self._past, None
        return boot not in self._past

    def begin(self, boot: int) -> None:
        """A new boot, or one of the past that is back: what still comes of the one before it is late."""
        if self.boot is not None:
            self._past[self.boot] = self.next or 0
        self._past.pop(boot, None)
        while len(self._past) > _REMEMBERED_BOOTS:
            del self._past[next(iter(self._past))]
        self.boot = boot
        self.next = None

    @property
    def first(self) -> int:
        """The number of the first sample of this boot that was heard."""
        return self._first

    def resume(self, boot: int, first: int, next_: int) -> None:
        """Go on within a boot that was first heard at a sample, from the sample with another number on."""
        self.begin(boot)
        self._first, self.next = first, next_

    def recall(self, boots: Callable[[], Iterable[int] | None]) -> None:
        """Boots, latest last, that were heard before anything is known of here: what comes of them is of the past.

        Asked for when there is another than the present one, until they are known: who takes over a hundred devices has other
        things to do.
        """
        self._before = boots

    def follows(self, batch: Samples) -> bool:
        """Whether its numbers go on from where its boot, this one or a past one, had come to."""
        came_to = self.next if batch.boot == self.boot else self._past.get(batch.boot)
        return came_to is None or batch.sequence + batch.n > came_to

    def jump(self, batch: Samples) -> None:
        """The numbers go on from here, how many samples were missed is not known."""
        if self.next is not None and batch.sequence > self.next:
            self._first += batch.sequence - self.next
            self.next = batch.sequence
        self.events.add("stream jumped")

    def refuse(self, batch: Samples, reason: str) -> None:
        """Count a batch that is not to be used at all."""
        self.samples_in += batch.n
        self.dropped.add(reason, batch.n)

    def drop(self, reason: str, n: int) -> None:
        """So many samples that `fresh` had let through are not to be used after all."""
        self.samples_out -= n
        self.dropped.add(reason, n)

    def anew(self, lost: int, uncounted: int) -> "SequenceNumbers":
        """The same counts and past boots, ready to begin.

        `lost` samples taken from it last came to nothing, or fewer than none, as so many more were published; `uncounted` ones
        came and did not even get here.
        """
        fresh = SequenceNumbers()
        fresh.samples_in, fresh.samples_out = self.samples_in + uncounted, self.samples_out - lost
        fresh.dropped, fresh.events, fresh._past = self.dropped, self.events, self._past
        fresh._before = self._before
        if lost + uncounted:
            fresh.dropped.add("session failed", lost + uncounted)
        return fresh

    def fresh(self, batch: Samples) -> int:
        """How many samples at the start of the batch are not to be used; all of them when none is."""
        n = batch.n
        self.samples_in += n
        if batch.sequence == self.next and batch.boot == self.boot:
            self.next += n
            self.samples_out += n
            return 0
        if batch.boot != self.boot:
            self.dropped.add(Reason.OLD_BOOT, n)
            return n
        if self.next is None:
            self.next = self._first = batch.sequence
        known = max(0, min(self.next - batch.sequence, n))
        if batch.sequence > self.next:
            self.events.add("gaps")
            self.events.add("missing_samples", batch.sequence - self.next)
        if known:
            self.dropped.add(Reason.DUPLICATE, known)
        self.next = max(self.next, batch.sequence + n)
        self.samples_out += n - known
        return known

    @property
    def seen(self) -> int:
        """Samples the device has made in this boot since it was first heard."""
        return 0 if self.next is None else self.next - self._first
