"""The samples of one boot as they go on in device time, cut into blocks; those of the one that is not over wait here."""

from bisect import bisect_left
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.wire.messages import SampleBatch
from estimator.block import SHORT_S, TIME, Block, Part, Stretch

Floats = NDArray[np.float64]

#: device time that is taken to have passed when a bridge, started anew, has lost count of the turns of the device's clock
CLOCK_LOST_S = 1.0
#: device time up to which samples may end after the one before and be looked at no further
PLAIN_S = 60.0
#: and which they are apart, at least
CLOSEST_S = 5e-6


class Point(NamedTuple):
    """Where a course is, s: device time of its latest sample, how far it is ahead of the device's clock, when its block ends."""

    latest: float
    shift: float
    until: float


class Course:
    """Begins at a device time, s; `latest` is that of the last sample."""

    def __init__(self, began: float) -> None:
        self.latest = began
        self._first: float | None = None
        self._block = Block()
        #: how long the blocks are that begin from here on, s; they end where device time is a multiple of it
        self.block_s = SHORT_S
        self._end_after(began)
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

    @property
    def point(self) -> Point:
        """From where on samples go on, of a course that has begun."""
        return Point(self.latest, self._shift, self._until)

    def goes_on(self, first_s: float, last_s: float, n: int) -> bool:
        """Whether n samples from first_s to last_s of the device's clock come after all others, soon, and are no crowd."""
        if self._first is None or not first_s + self._shift > self.latest:
            return False
        return n * CLOSEST_S <= last_s + self._shift - self.latest < PLAIN_S

    def ends_block(self, last_s: float) -> bool:
        """Whether a sample at last_s of the device's clock is beyond the block that waits."""
        return last_s + self._shift >= self._until

    def went_back(self, first_s: float, away_s: float) -> bool:
        """Whether the device's clock has; from here on it is taken to go on, by what the host has seen pass at least."""
        if self._first is None or first_s + self._shift > self.latest:
            return False
        self._shift += self.latest + max(CLOCK_LOST_S, away_s) - (first_s + self._shift)
        return True

    def set_right(self, rows: Floats) -> None:
        """In rows of samples (n, 7), device time, which only goes on, in place of what the device's clock shows."""
        if self._shift:
            rows[:, TIME] += self._shift

    def keep(self, rows: Floats, stretch: Stretch) -> None:
        """Let batches without flags wait that end no block: their rows (n, 7), time by the device's clock."""
        self.set_right(rows)
        self._block.add(rows, None, stretch, 0)
        self.latest = rows.item(-1, TIME)

    def edges(self, rows: Floats) -> Iterator[int]:
        """Which of the samples that come next, rows (n, 7), begin a block; each may be told how long it is as it begins."""
        taken = rows[:, TIME].tolist()
        if self._first is None:
            self._first = taken[0]
        self.latest = taken[-1]
        edge = bisect_left(taken, self._until)
        while edge < len(taken):
            yield edge
            self._end_after(taken[edge])
            edge = bisect_left(taken, self._until, edge + 1)

    def _end_after(self, begun: float) -> None:
        self._until = (begun // self.block_s + 1) * self.block_s

    def hold(self, rows: Floats, flags: NDArray[np.uint32] | None, of: SampleBatch | Stretch, first: int) -> None:
        """Let samples of a batch, or a stretch, from first on wait: rows (n, 7), flags (n,), if there are any."""
        if len(rows):
            self._block.add(rows, flags, of, first)

    def take(self) -> list[Part]:
        """All that wait, once."""
        return self._block.take()

    def place(self, index: int) -> tuple[SampleBatch | Stretch, int]:
        """The batch or stretch, and the place in it, of a sample of the boot that is not forgotten."""
        return self._block.place(index)

    def forget(self, index: int) -> None:
        """What was before this sample of the boot."""
        self._block.forget(index)
