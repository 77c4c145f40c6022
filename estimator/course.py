"""The samples of one boot as they go on in device time, cut into half seconds; those of the one that is not over wait here."""

import numpy as np
from numpy.typing import NDArray

from bridge.wire.messages import SampleBatch
from estimator.block import BLOCK_S, Block, Part

Floats = NDArray[np.float64]

#: device time that is taken to have passed when a bridge, started anew, has lost count of the turns of the device's clock
CLOCK_LOST_S = 1.0
#: device time up to which samples may end after the one before and be looked at no further
PLAIN_S = 60.0


class Course:
    """Begins at a device time, s; `latest` is that of the last sample."""

    def __init__(self, began: float) -> None:
        self.latest = began
        self._first: float | None = None
        self._block, self._number = Block(), int(began // BLOCK_S)
        self._shift = 0.0  # of a clock that went back

    def anew(self) -> "Course":
        """Of the same boot from here on: what waits is forgotten."""
        anew = Course(self.latest)
        anew._first, anew._shift = self._first, self._shift
        return anew

    @property
    def seconds(self) -> float:
        """From the first sample to the last."""
        return 0.0 if self._first is None else self.latest - self._first

    def goes_on(self, first_s: float, last_s: float) -> bool:
        """Whether samples from first_s to last_s of the device's clock come after all others, and not long after."""
        if self._first is None:
            return False
        return first_s + self._shift > self.latest and last_s + self._shift < self.latest + PLAIN_S

    def ends_block(self, last_s: float) -> bool:
        """Whether a sample at last_s of the device's clock is beyond the block that waits."""
        return (last_s + self._shift) // BLOCK_S != self._number

    def went_back(self, first_s: float, away_s: float) -> bool:
        """Whether the device's clock has; from here on it is taken to go on, by what the host has seen pass at least."""
        if self._first is None or first_s + self._shift > self.latest:
            return False
        self._shift += self.latest + max(CLOCK_LOST_S, away_s) - (first_s + self._shift)
        return True

    def time(self, clock_s: Floats) -> Floats:
        """(n,) device time, which only goes on, of what the device's clock shows."""
        return clock_s + self._shift if self._shift else clock_s

    def keep(self, time: Floats, batch: SampleBatch) -> None:
        """Let a batch wait that ends no block, taken at time (n,)."""
        self._block.add(time, batch, 0, len(time))
        self.latest = float(time[-1])

    def edges(self, time: Floats) -> list[int]:
        """Which of the samples that come next, taken at time (n,), begin a block."""
        if self._first is None:
            self._first = float(time[0])
        blocks = time // BLOCK_S
        edges = [] if blocks[0] == self._number else [0]
        self._number, self.latest = int(blocks[-1]), float(time[-1])
        edges += ((blocks[1:] != blocks[:-1]).nonzero()[0] + 1).tolist()
        return edges

    def hold(self, time: Floats, batch: SampleBatch, first: int, last: int) -> None:
        """Let samples first to last of a batch wait, taken at time (last - first,)."""
        if last > first:
            self._block.add(time, batch, first, last)

    def take(self) -> list[Part]:
        """All that wait, once."""
        return self._block.take()

    def where(self, index: int) -> tuple[SampleBatch, int]:
        """The batch and the place in it of a sample of the boot; those before it are forgotten."""
        return self._block.where(index)
