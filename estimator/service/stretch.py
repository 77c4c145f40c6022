"""Plain batches of one device, as they were sent: read again where somebody asks for one of them, which is seldom."""

from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate

from bridge.wire.batches import samples_of
from bridge.wire.messages import SampleBatch


class Sent:
    """Payloads that follow each other without a hole, of n samples each; see block.Stretch."""

    __slots__ = ("_bridge", "_ends", "_payloads", "_read", "boot", "sequence")

    def __init__(self, boot: int, sequence: int, payloads: Sequence[bytes], n: Sequence[int], bridge: str) -> None:
        self.boot, self.sequence = boot, sequence
        self._payloads, self._ends, self._bridge = tuple(payloads), tuple(accumulate(n)), bridge
        self._read: tuple[int, SampleBatch] | None = None  # the last that was asked for

    def where(self, index: int) -> tuple[SampleBatch, int]:
        """The batch and the place in it of a sample of them."""
        number = bisect_right(self._ends, index)
        if self._read is None or self._read[0] != number:
            self._read = number, samples_of(self._payloads[number], self._bridge)
        batch = self._read[1]
        return batch, index - self._ends[number] + len(batch)
