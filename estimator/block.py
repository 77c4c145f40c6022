"""Samples that wait until their half second of device time is over: they teach something together, however they came."""

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.wire.messages import SampleBatch, SampleFlag

Floats = NDArray[np.float64]

BLOCK_S = 0.5
#: what marks a reading that tells nothing of rotation
UNFIT = SampleFlag.CLIPPED | SampleFlag.STUCK


def sample_time_ns(batch: SampleBatch, index: int) -> int:
    """Host time of a sample of a batch, ns since the Unix epoch."""
    since = float(batch.ticks[index] - batch.ticks[0]) * batch.tick_period_s * batch.clock_rate
    return batch.start_time_ns + round(since * 1e9)


def temperature_at(batch: SampleBatch, index: int) -> float | None:
    """°C at a sample; None where a batch has none, or the bridge marked a leap of it."""
    if batch.temperature_c is None or batch.flags[index] & SampleFlag.TEMPERATURE_STEP:
        return None
    return float(batch.temperature_c[index])


class Part(NamedTuple):
    """Samples first to last of a batch: their device time (n,) s, and how many of the boot came before them."""

    time: Floats
    batch: SampleBatch
    first: int
    last: int
    before: int


class Run(NamedTuple):
    """Samples of some parts: device time (n,) s, gyro (n, 3), accel (n, 3) or None, flags (n,), which of them are unfit (n,)."""

    time: Floats
    gyro: Floats
    accel: Floats | None
    flags: NDArray[np.uint32]
    unfit: NDArray[np.bool_]
    parts: list[Part]

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
        if end - first == len(self.time):
            return np.arange(first, end)
        return np.concatenate([np.arange(part.first, part.last) + part.batch.sequence for part in self.parts])


class Block:
    """The samples of one boot that wait, and where each of the latest ones is."""

    def __init__(self) -> None:
        self._count = 0
        self._waiting: list[Part] = []
        self._known: deque[Part] = deque()

    def add(self, time: Floats, batch: SampleBatch, first: int, last: int) -> None:
        """Let samples first to last of a batch wait, taken at time (last - first,), device s."""
        part = Part(time, batch, first, last, self._count)
        self._count += last - first
        self._waiting.append(part)
        self._known.append(part)

    def take(self) -> list[Part]:
        """All that wait, once."""
        waiting, self._waiting = self._waiting, []
        return waiting

    def where(self, index: int) -> tuple[SampleBatch, int]:
        """The batch and the place in it of a sample of the boot; those before it are forgotten."""
        while self._known[0].before + self._known[0].last - self._known[0].first <= index:
            self._known.popleft()
        part = self._known[0]
        return part.batch, part.first + index - part.before


def joined(parts: list[Part]) -> Iterator[Run]:
    """Parts in runs with or without accelerometer."""
    begin = 0
    for end in range(1, len(parts) + 1):
        if end == len(parts) or (parts[end].batch.accel is None) != (parts[begin].batch.accel is None):
            yield _joined(parts[begin:end])
            begin = end


def _joined(parts: list[Part]) -> Run:
    time = np.concatenate([part.time for part in parts])
    gyro = np.concatenate([part.batch.gyro[part.first : part.last] for part in parts]).astype(np.float64)
    flags = np.concatenate([part.batch.flags[part.first : part.last] for part in parts])
    accel = None
    if parts[0].batch.accel is not None:
        forces = [part.batch.accel[part.first : part.last] for part in parts if part.batch.accel is not None]
        accel = np.concatenate(forces).astype(np.float64)
    return Run(time, gyro, accel, flags, (flags & UNFIT) != 0, parts)
