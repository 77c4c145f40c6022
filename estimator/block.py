"""Samples that wait until their second of device time is over: they teach something together, however they came."""

from bisect import bisect_right
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from bridge.wire.messages import SampleBatch, SampleFlag

Floats = NDArray[np.float64]

#: a second; half of one while somebody waits for what comes of a calibration's first rest, or of turns
BLOCK_S, SHORT_S = 1.0, 0.5
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


class Stretch(Protocol):
    """Batches of one boot that follow each other without a hole, and the number of their first sample."""

    @property
    def boot(self) -> int:
        """Whose they are."""

    @property
    def sequence(self) -> int:
        """The number of the first sample."""

    @property
    def warm(self) -> bool:
        """Whether any of them has temperatures."""

    def where(self, index: int) -> tuple[SampleBatch, int]:
        """The batch and the place in it of a sample of them."""

    def time_ns(self, index: int) -> int:
        """Host time of a sample of them, ns since the Unix epoch."""

    def temperature(self, index: int) -> float | None:
        """°C at a sample of them; None where there is none."""


class Part(NamedTuple):
    """Samples of a batch, or a stretch, from first on: rows (n, 7), and how many of the boot there were with them.

    flags: (n,), or None where none of them has any.
    """

    rows: Floats
    flags: NDArray[np.uint32] | None
    of: SampleBatch | Stretch
    first: int
    came: int

    @property
    def sequence(self) -> int:
        """The number of its first sample."""
        return self.of.sequence + self.first

    def where(self, index: int) -> tuple[SampleBatch, int]:
        """The batch and the place in it of one of its samples."""
        return where(self.of, self.first + index)

    @property
    def last(self) -> tuple[SampleBatch, int]:
        """The same of its last one."""
        return self.where(len(self.rows) - 1)


def where(of: SampleBatch | Stretch, index: int) -> tuple[SampleBatch, int]:
    """The batch and the place in it of a sample of either."""
    return (of, index) if isinstance(of, SampleBatch) else of.where(index)


def time_ns_at(of: SampleBatch | Stretch, index: int) -> int:
    """`sample_time_ns` of a sample of either, for which no batch is made."""
    return sample_time_ns(of, index) if isinstance(of, SampleBatch) else of.time_ns(index)


def has_celsius(of: SampleBatch | Stretch) -> bool:
    """Whether any sample of either has a temperature."""
    return of.temperature_c is not None if isinstance(of, SampleBatch) else of.warm


def celsius_at(of: SampleBatch | Stretch, index: int) -> float | None:
    """`temperature_at` of a sample of either, for which no batch is made."""
    return temperature_at(of, index) if isinstance(of, SampleBatch) else of.temperature(index)


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
        return self.parts[-1].of.boot

    @property
    def last(self) -> tuple[SampleBatch, int]:
        """The batch and the place in it of the last of them."""
        return self.parts[-1].last

    @property
    def sequences(self) -> NDArray[np.int64]:
        """(n,) their sequence numbers."""
        first, end = self.parts[0].sequence, self.parts[-1].sequence + len(self.parts[-1].rows)
        if end - first == len(self.rows):
            return np.arange(first, end)
        return np.concatenate([np.arange(len(part.rows)) + part.sequence for part in self.parts])


class Block:
    """The samples of one boot that wait, and where each of the latest ones is."""

    def __init__(self) -> None:
        self._count = 0
        self._waiting: list[Part] = []
        self._known: list[Part] = []
        self._came: list[int] = []  # of each of those

    def add(self, rows: Floats, flags: NDArray[np.uint32] | None, of: SampleBatch | Stretch, first: int) -> None:
        """Let samples of a batch, or a stretch, from first on wait: rows (n, 7), flags (n,) or None where none has any."""
        self._count += len(rows)
        part = Part(rows, flags, of, first, self._count)
        self._waiting.append(part)
        self._known.append(part)
        self._came.append(self._count)

    def take(self) -> list[Part]:
        """All that wait, once."""
        waiting, self._waiting = self._waiting, []
        return waiting

    def place(self, index: int) -> tuple[SampleBatch | Stretch, int]:
        """The batch or stretch, and the place in it, of a sample of the boot that is not forgotten."""
        part = self._known[bisect_right(self._came, index)]
        place = len(part.rows) - (part.came - index)
        if place < 0:
            raise IndexError(f"sample {index} of the boot is forgotten")
        return part.of, part.first + place

    def forget(self, index: int) -> None:
        """What was before this sample of the boot."""
        before = bisect_right(self._came, index)
        del self._known[:before], self._came[:before]


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
