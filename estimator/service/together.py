"""The messages of a round read all at once, and written, corrected: what is out of the ordinary goes its own way."""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.wire import columns_pb2 as columns
from bridge.wire.batches import MAX_ACCEL, MAX_CELSIUS, MAX_CORRECTED, MAX_RATE, MAX_SAMPLES, MAX_SEQUENCE
from bridge.wire.checks import MAX_TIME_NS
from bridge.wire.messages import VERSION, SampleBatch
from estimator.correction import Correction
from estimator.loops.messages import MOST_OF_ONE, corrected, unpacked

Floats = NDArray[np.float64]

#: far enough from the end for any batch: samples of it, its number, its times
_MOST = np.array([MAX_SAMPLES, MAX_SEQUENCE - MAX_SAMPLES, MAX_TIME_NS - 10**15], np.uint64)
_LIMITS = np.array([MAX_RATE, MAX_ACCEL, MAX_CELSIUS])
#: bytes that a sample takes at least, and takes when it is corrected
_LEAST_OF_SAMPLE = _CORRECTED = 8 + 12


class Sender(NamedTuple):
    """A device, the bridge it comes from, and how each message of it begins."""

    device: str
    bridge: str
    begin: bytes

    @classmethod
    def of(cls, device: str, bridge: str) -> "Sender":
        """The one of this device and this bridge."""
        return cls(device, bridge, columns.SampleBatch(version=VERSION, device=device).SerializeToString())


class Come(NamedTuple):
    """A batch, the rows (n, 7) of its samples as a block has them, and when the first and last were taken by their clock, s."""

    batch: SampleBatch
    rows: Floats
    first_s: float
    last_s: float
    #: which message of the round it is
    number: int


class Round(NamedTuple):
    """What came of each message, None where it must go its own way; for the others see loops/messages.py."""

    come: list[Come | None]
    whole: NDArray[np.uint64]
    real: Floats
    ticks: NDArray[np.uint64]
    rows: Floats

    def corrected(self, parts: Sequence[tuple[Come, Correction, int, int]]) -> list[bytes]:
        """Samples of batches, from the first to the last, as messages of corrected ones have them (see Stencil).

        Empty where a rate is beyond the wire's range.
        """
        m, room, which = len(parts), 0, list[int]()
        for come, _, first, last in parts:
            which += come.number, first, last
            room += MOST_OF_ONE + _CORRECTED * (last - first)
        parameters = np.concatenate([correction.parameters for _, correction, _, _ in parts]).reshape(m, 12)
        packed, ends = np.empty(room, np.uint8), np.empty(m, np.int64)
        corrected(np.array(which, np.int64).reshape(m, 3), parameters, *self[1:], MAX_CORRECTED, packed, ends)
        said, begin, found = packed.tobytes(), 0, list[bytes]()
        for end in ends.tolist():
            found.append(said[begin:end])
            begin = end
        return found


def read(payloads: Sequence[bytes], senders: Sequence[Sender | None]) -> Round:
    """The messages of a round, each from a sender that is known, or None.

    Only how long after its first sample a batch ends is not looked at: one that goes on plainly ends soon (see Course).
    """
    m, packed = len(payloads), np.frombuffer(bytearray().join(payloads), np.uint8)
    places, end = list[int](), 0
    for payload, sender in zip(payloads, senders, strict=True):
        begin, end = end, end + len(payload)
        places += begin + len(sender.begin) if sender and payload.startswith(sender.begin) else end, end
    n = len(packed) // _LEAST_OF_SAMPLE
    ticks, rows, celsius = np.empty(n, np.uint64), np.empty((n, 7)), np.empty(n, np.float32)
    gyro, accel = np.empty((n, 3), np.float32), np.empty((n, 3), np.float32)
    whole, real = np.empty((m, 8), np.uint64), np.empty((m, 4))
    of_all = np.array(places, np.int64).reshape(m, 2), _MOST, _LIMITS, whole, real
    unpacked(packed, *of_all, ticks, gyro, accel, celsius, rows)
    found = list[Come | None]()
    for number, (sender, numbers, others) in enumerate(zip(senders, whole.tolist(), real.tolist(), strict=True)):
        n, begin, boot, sequence, received_ns, start_ns, aided, warm = numbers
        if sender is None or not n:
            found.append(None)
            continue
        period_s, rate, first_s, last_s = others
        here = slice(begin, begin + n)
        batch = SampleBatch(
            sender.device,
            boot,
            sequence,
            received_ns,
            start_ns,
            period_s,
            rate,
            ticks[here],
            gyro[here],
            accel[here] if aided else None,
            celsius[here] if warm else None,
            _no_flags(n),
            sender.bridge,
        )
        found.append(Come(batch, rows[here], first_s, last_s, number))
    return Round(found, whole, real, ticks, rows)


@cache
def _no_flags(n: int) -> NDArray[np.uint32]:
    flags = np.zeros(n, np.uint32)
    flags.setflags(write=False)
    return flags
