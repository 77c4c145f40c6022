"""Sequence number tracking: accepts every sample of a boot once, and counts duplicates and gaps."""

from collections.abc import Callable, Iterable

from bridge.wire.refusal import Reason, Tally
from estimator.samples.sample_buffer import Samples

_REMEMBERED_BOOTS = 64


class SequenceNumbers:
    """Sequence numbers and boots of one device, with counters of its samples.

    `samples_in`, `samples_out`: numbers of samples received and accepted. `dropped`: refused samples by reason.
    `events`: number of gaps, and of the samples missing in them. `next`: sequence number expected next, None
    before the first.
    """

    def __init__(self) -> None:
        self.boot: int | None = None
        self.samples_in = self.samples_out = 0
        self.dropped, self.events = Tally(), Tally()
        self._past: dict[int, int] = {}  # earlier boots, latest last, with the sequence number each had reached
        self._before: Callable[[], Iterable[int] | None] | None = None
        #: number of the next sample; None before the first of a boot
        self.next: int | None = None
        #: sequence number of the first sample heard in this boot
        self.first = 0

    def is_new_boot(self, boot: int) -> bool:
        """Return whether a boot id is new for this device, which means that the device has restarted.

        Not new are the present boot id and the ids of earlier boots, also those from the lookup set by `recall`.
        """
        if boot == self.boot or boot in self._past:
            return False
        before = None if self._before is None else self._before()
        if before is not None:
            self._past, self._before = dict.fromkeys(before, 0) | self._past, None
        return boot not in self._past

    def begin(self, boot: int) -> None:
        """Begin a new boot by its id, or return to an earlier one; later samples of the previous boot count as old."""
        if self.boot is not None:
            self._past[self.boot] = self.next or 0
        self._past.pop(boot, None)
        while len(self._past) > _REMEMBERED_BOOTS:
            del self._past[next(iter(self._past))]
        self.boot = boot
        self.next = None

    def resume(self, boot: int, first: int, next_: int) -> None:
        """Continue boot `boot` at sequence number `next_`; `first` is that of its first received sample."""
        self.begin(boot)
        self.first, self.next = first, next_

    def recall(self, boots: Callable[[], Iterable[int] | None]) -> None:
        """Set a lookup for boot ids from before this estimator knew the device; samples of these boots count as old.

        boots: returns the ids, latest last, or None while they are not available. The lookup is called when an unknown
        boot appears, until it returns ids. So a takeover of many devices need not load all boots first.
        """
        self._before = boots

    def follows(self, batch: Samples) -> bool:
        """Return whether a batch has samples beyond the last known sequence number of its boot, present or earlier."""
        came_to = self.next if batch.boot == self.boot else self._past.get(batch.boot)
        return came_to is None or batch.sequence + batch.n > came_to

    def jump(self, batch: Samples) -> None:
        """Continue at the batch's sequence number after a leap; skipped numbers do not count as missing samples."""
        if self.next is not None and batch.sequence > self.next:
            self.first += batch.sequence - self.next
            self.next = batch.sequence
        self.events.add("stream jumped")

    def refuse(self, batch: Samples, reason: str) -> None:
        """Count all samples of a batch as received and as dropped for the given reason."""
        self.samples_in += batch.n
        self.dropped.add(reason, batch.n)

    def anew(self, came: int, out: int) -> "SequenceNumbers":
        """Return counters for a new session after a failed one: same counts and past boots, no current boot.

        came, out: numbers of samples received and published. The difference counts as dropped by the failed session.
        """
        fresh = SequenceNumbers()
        fresh.samples_in, fresh.samples_out = came, out
        fresh.dropped, fresh.events, fresh._past = self.dropped, self.events, self._past
        fresh._before = self._before
        fresh.dropped.add("session failed", came - out - self.dropped.total())
        return fresh

    def fresh(self, batch: Samples) -> int:
        """Count a batch as received; return the number of its leading samples to skip.

        Samples to skip are duplicates. If the batch belongs to another boot than the present one, all its samples are
        skipped.
        """
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
            self.next = self.first = batch.sequence
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
        """Number of samples made in this boot since the first received one, missing samples included."""
        return 0 if self.next is None else self.next - self.first
