"""Plain batches of one device, as they were sent: made where somebody asks for one of them."""

from collections.abc import Sequence
from functools import cache
from struct import Struct

import numpy as np
from numpy.typing import NDArray

from bridge.wire.messages import SampleBatch
from estimator.block import temperature_at
from estimator.loops.messages import (
    ACCEL,
    BOOT,
    CELSIUS,
    COUNT,
    GYRO,
    PERIOD,
    RATE,
    SEQUENCE,
    START,
    TICKS,
)

_TICK = Struct("<Q")
_UINT64, _FLOAT = np.dtype("<u8"), np.dtype("<f4")


class Sent:
    """Payloads that follow each other without a hole; see block.Stretch.

    whole and real: what is said of them (see loops/messages.py), columns counted from `begin`, where the first of them does.
    """

    __slots__ = ("_begin", "_made", "_payloads", "_real", "_sender", "_whole", "warm")

    def __init__(
        self,
        payloads: Sequence[bytes],
        whole: NDArray[np.uint64],
        real: NDArray[np.float64],
        begin: int,
        sender: tuple[str, str],
    ) -> None:
        self._payloads, self._whole, self._real = tuple(payloads), whole, real
        self._begin, self._sender = begin, sender  # device and bridge
        self.warm = any(whole[:, CELSIUS].tolist())
        self._made: tuple[int, SampleBatch] | None = None  # the last that was asked for

    @property
    def boot(self) -> int:
        """Whose they are."""
        return self._whole.item(0, BOOT)

    @property
    def sequence(self) -> int:
        """The number of the first sample."""
        return self._whole.item(0, SEQUENCE)

    def where(self, index: int) -> tuple[SampleBatch, int]:
        """The batch and the place in it of a sample of them."""
        number, index = self._place(index)
        if self._made is None or self._made[0] != number:
            self._made = number, self._batch(number)
        return self._made[1], index

    def time_ns(self, index: int) -> int:
        """Host time of a sample of them, as sample_time_ns of block.py has it, to the bit."""
        number, index = self._place(index)
        payload, at = self._payloads[number], self._whole.item(number, TICKS) - self._before(number)
        (first,), (tick,) = _TICK.unpack_from(payload, at), _TICK.unpack_from(payload, at + _TICK.size * index)
        since = float(tick - first) * self._real.item(number, PERIOD) * self._real.item(number, RATE)
        return self._whole.item(number, START) + round(since * 1e9)

    def temperature(self, index: int) -> float | None:
        """°C at a sample of them; None where there is none."""
        return temperature_at(*self.where(index)) if self.warm else None

    def _place(self, index: int) -> tuple[int, int]:
        number = 0
        while index >= (n := self._whole.item(number, COUNT)):
            number, index = number + 1, index - n
        return number, index

    def _before(self, number: int) -> int:
        """Where a payload begins among the columns."""
        return self._begin + sum(map(len, self._payloads[:number]))

    def _batch(self, number: int) -> SampleBatch:
        n, _, boot, sequence, received_ns, start_ns, *columns, _ = self._whole[number].tolist()
        begin, payload = self._before(number), self._payloads[number]
        accel, celsius = columns[ACCEL - TICKS], columns[CELSIUS - TICKS]
        return SampleBatch(
            self._sender[0],
            boot,
            sequence,
            received_ns,
            start_ns,
            self._real.item(number, PERIOD),
            self._real.item(number, RATE),
            np.frombuffer(payload, _UINT64, n, columns[0] - begin),
            np.frombuffer(payload, _FLOAT, 3 * n, columns[GYRO - TICKS] - begin).reshape(n, 3),
            np.frombuffer(payload, _FLOAT, 3 * n, accel - begin).reshape(n, 3) if accel else None,
            np.frombuffer(payload, _FLOAT, n, celsius - begin) if celsius else None,
            _no_flags(n),
            self._sender[1],
        )


@cache
def _no_flags(n: int) -> NDArray[np.uint32]:
    flags = np.zeros(n, np.uint32)
    flags.setflags(write=False)
    return flags
