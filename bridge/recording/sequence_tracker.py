"""Tracker of a boot's sequence numbers: finds repeated samples, gaps, and numbers that start over."""

from typing import NamedTuple

from bridge.wire.messages import CorrectedBatch, SampleBatch

#: known numbers that come this much later are no repeats: the device restarted under the same boot id
ANEW_NS = 1_000_000_000


class Continuation(NamedTuple):
    """How a batch continues the batches received before it: repeated samples, missing samples, time step.

    skip: number of samples at the beginning of the batch that were received before. missing: number of samples lost
    before the first new sample. anew: True if the sequence numbers start over, also at the first batch.
    step: device clock ticks from the last sample received before to the first new one; 0 if `anew`, or if no sample is
    new.
    """

    skip: int
    missing: int = 0
    anew: bool = False
    step: int = 0


class SequenceTracker:
    """Tracker of the sequence numbers of one boot of a device, to find repeated and missing samples."""

    def __init__(self) -> None:
        self._next: int | None = None
        self._tick = 0
        self._time_ns = 0

    def follow(self, batch: SampleBatch | CorrectedBatch) -> Continuation:
        """Return how a batch continues the batches before it, and store its last sequence number, tick and time.

        A batch whose samples were all received before leaves the stored values unchanged.
        """
        follows = self._judge(batch)
        if follows.skip < len(batch):
            self._next = batch.sequence + len(batch)
            self._tick = int(batch.ticks[-1])
            self._time_ns = max(self._time_ns, batch.start_time_ns) if not follows.anew else batch.start_time_ns
        return follows

    def _judge(self, batch: SampleBatch | CorrectedBatch) -> Continuation:
        if self._next is None:
            return Continuation(0, anew=True)
        skip = max(0, self._next - batch.sequence)
        if skip >= len(batch):
            later = batch.start_time_ns > self._time_ns + ANEW_NS
            return Continuation(0, anew=True) if later else Continuation(len(batch))
        step = int(batch.ticks[skip]) - self._tick
        if step <= 0:
            return Continuation(0, anew=True)
        return Continuation(skip, max(0, batch.sequence - self._next), step=step)
