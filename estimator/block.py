"""Samples that wait until their half second of device time is over: they teach something together, however they came."""

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.wire.messages import SampleBatch, SampleFlag

Floats = NDArray[np.float64]

BLOCK_S = 0.5
#: what marks a reading that tells nothing of rotation
UNFIT = np.uint32(SampleFlag.CLIPPED | SampleFlag.STUCK)
_STEP = int(SampleFlag.TEMPERATURE_STEP)


def sample_time_ns(batch: SampleBatch, index: int) -> int:
    """Host time of a sample of a batch, ns since the Unix epoch."""
    since = float(batch.ticks.item(index) - batch.ticks.item(0)) * batch.tick_period_s * batch.clock_rate
    return batch.start_time_ns + round(since * 1e9)


def temperature_at(batch: SampleBatch, index: int) -> float | None:
    """°C at a sample; None where a batch has none, or the bridge marked a leap of it."""
    if batch.temperature_c is None or batch.flags.item(index) & _STEP:
        return None
    return batch.temperature_c.item(index)


#: columns of rows of samples: device time, gyro, accel
TIME, GYRO, ACCEL = 0, slice(1, 4), slice(4, 7)


def rows_of(batch: SampleBatch, first: int, last: int) -> Floats:
    """(n, 7) samples first to last of a batch, time by the device's clock; NaN where it has no accelerometer."""
    here, rows = slice(first, last), np.empty((last - first, 7))
    rows[:, TIME], rows[:, GYRO] = batch.device_time[here], batch.gyro[here]
    rows[:, ACCEL] = np.nan if batch.accel is None else batch.accel[here]
    return rows


class Part(NamedTuple):
    """Samples of a batch from first on: rows (n, 7), and how many of the boot there were with them.

    flags: (n,), or None where none of them has any.
    """

    rows: Floats
    flags: NDArray[np.uint32] | None
    batch: SampleBatch
    first: int
    came: int

    @property
    def last(self) -> int:
        """The end of them in their batch."""
        return self.first + len(self.rows)


class Run(NamedTuple):
    """Samples of some parts, rows (n, 7), and their flags (n,)."""

    rows: Floats
    flags: NDArray[np.uint32]
    parts: list[Part]

    @property
    def time(self) -> Floats:
        """(n,) s, of the device."""
        return self.rows[:, TIME]

    @property
    def gyro(self) -> Floats:
        """(n, 3) rad/s."""
        return self.rows[:, GYRO]

    @property
    def boot(self) -> int:
        """Whose samples they are."""
        return self.parts[-1].batch.boot

    @property
    def last(self) -> Part:
        """The part with the last of them."""
        return self.parts[-1]

    @property
    def sequences(self) -> NDArray[np.int64]:
        """(n,) their sequence numbers."""
        first, end = self.parts[0].batch.sequence + self.parts[0].first, self.last.batch.sequence + self.last.last
        if end - first == len(self.rows):
            return np.arange(first, end)
        return np.concatenate([np.arange(part.first, part.last) + part.batch.sequence for part in self.parts])


class Block:
    """The samples of one boot that wait, and where each of the latest ones is."""

    def __init__(self) -> None:
        self._count = 0
        self._waiting: list[Part] = []
        self._known: deque[Part] = deque()

    def add(self, rows: Floats, flags: NDArray[np.uint32] | None, batch: SampleBatch, first: int) -> None:
        """Let samples of a batch from first on wait: rows (n, 7), flags (n,) or None where none of them has any."""
        self._count += len(rows)
        part = Part(rows, flags, batch, first, self._count)
        self._waiting.append(part)
        self._known.append(part)

    def take(self) -> list[Part]:
        """All that wait, once."""
        waiting, self._waiting = self._waiting, []
        return waiting

    def where(self, index: int) -> tuple[SampleBatch, int]:
        """The batch and the place in it of a sample of the boot; those before it are forgotten."""
        known = self._known
        while (part := known[0]).came <= index:
            known.popleft()
        return part.batch, part.first + len(part.rows) - (part.came - index)


def joined(parts: list[Part]) -> Run:
    """Parts as one."""
    return Run(np.concatenate([part.rows for part in parts]), _flags(parts), parts)


def unfit(parts: list[Part]) -> NDArray[np.bool_] | None:
    """Which of the samples of parts are unfit (n,); None where none of them has any flags."""
    for part in parts:
        if part.flags is not None:
            return np.asarray((_flags(parts) & UNFIT) != 0)
    return None


def _flags(parts: list[Part]) -> NDArray[np.uint32]:
    return np.concatenate([np.zeros(len(p.rows), np.uint32) if p.flags is None else p.flags for p in parts])
