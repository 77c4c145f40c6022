"""The messages of a round read all at once, and written, corrected: what is out of the ordinary goes its own way."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.wire.batches import MAX_ACCEL, MAX_CELSIUS, MAX_CORRECTED, MAX_RATE, MAX_SAMPLES, MAX_SEQUENCE
from bridge.wire.checks import MAX_TIME_NS
from estimator.correction import Correction
from estimator.loops.messages import (
    AHEAD,
    BOOT,
    COUNT,
    FIRST,
    FIRST_S,
    LAST_S,
    MOST_OF_ONE,
    RECEIVED,
    SEQUENCE,
    corrected,
    unpacked,
)
from estimator.service.senders import Sender, Senders
from estimator.service.stretch import Sent

Floats = NDArray[np.float64]
Wholes = NDArray[np.int64]

#: far enough from the end for any batch: samples of it, its number, its times
_MOST = np.array([MAX_SAMPLES, MAX_SEQUENCE - MAX_SAMPLES, MAX_TIME_NS - 10**15], np.uint64)
_LIMITS = np.array([MAX_RATE, MAX_ACCEL, MAX_CELSIUS])
#: bytes that a sample takes at least, and takes when it is corrected
_LEAST_OF_SAMPLE = _CORRECTED = 8 + 12
#: a part by itself: nothing before it, nothing behind
_BARE = np.empty((0, 0), np.uint8)


class Come(NamedTuple):
    """Messages of one device that follow each other without a hole, and the rows (n, 7) of their samples as a block has them.

    Where they end: the number that follows, and the device's clock, s; when the earliest and the last were received.
    """

    sent: Sent
    rows: Floats
    following: int
    last_s: float
    earliest_ns: int
    received_ns: int
    #: which message of the round the first of them is
    number: int


class Span(NamedTuple):
    """Boot, sequence number and receive time of a batch; when its first and last sample were taken, by their clock; how many."""

    boot: int
    sequence: int
    received_ns: int
    first_s: float
    last_s: float
    samples: int


class Round:
    """What came of the messages of a round; for the arrays see loops/messages.py.

    places (m,): whose they are among the senders. goes_on: whether those that only go on are to be corrected ahead.
    Only how long after its first sample a batch ends is not looked at: one that goes on plainly ends soon (see Course).
    """

    def __init__(self, payloads: Sequence[bytes], places: Sequence[int], senders: Senders, *, goes_on: bool) -> None:
        m = len(payloads)
        self._payloads, self._senders, self._places = payloads, senders, np.array(places, np.int64)
        self._packed = np.frombuffer(bytearray().join(payloads), np.uint8)
        self._sizes = np.fromiter(map(len, payloads), np.int64, m)
        self._begins = np.cumsum(self._sizes) - self._sizes
        self._whole, self._real = np.empty((m, 11), np.uint64), np.empty((m, 4))
        self._rows = np.empty((len(self._packed) // _LEAST_OF_SAMPLE, 7))
        unpacked(
            self._packed,
            self._sizes,
            self._places,
            goes_on,
            _MOST,
            _LIMITS,
            *senders.table,
            self._whole,
            self._real,
            self._rows,
        )

    @property
    def ahead(self) -> Wholes:
        """Which messages go on where their senders are."""
        return np.flatnonzero(self._whole[:, AHEAD])

    @property
    def others(self) -> list[int]:
        """Which do not, or are nobody's, or unfit."""
        return np.flatnonzero(self._whole[:, AHEAD] == 0).tolist()

    def samples(self, messages: Wholes | list[int] | slice) -> int:
        """How many they have together."""
        return int(sum(self._whole[messages, COUNT].tolist()))

    def following(self, number: int) -> int:
        """The number of the sample that follows a message."""
        return self._whole.item(number, SEQUENCE) + self._whole.item(number, COUNT)

    def fit(self, number: int) -> bool:
        """Whether a message is from a sender, and all of it as it should be; else it must go its own way."""
        return bool(self._whole.item(number, COUNT))

    def come(self, begin: int, end: int, sender: Sender) -> Come:
        """Messages of one sender, fit and without a hole; nothing of the round is kept with them."""
        whole, real = self._whole[begin:end].copy(), self._real[begin:end].copy()
        first, n, received_ns = whole.item(0, FIRST), sum(whole[:, COUNT].tolist()), whole[:, RECEIVED].tolist()
        return Come(
            Sent(self._payloads[begin:end], whole, real, self._begins.item(begin), sender[:2]),
            self._rows[first : first + n].copy(),
            whole.item(0, SEQUENCE) + n,
            real.item(-1, LAST_S),
            min(received_ns),
            received_ns[-1],
            begin,
        )

    def span(self, number: int) -> Span:
        """Where a message is."""
        whole, real = self._whole, self._real
        return Span(
            whole.item(number, BOOT),
            whole.item(number, SEQUENCE),
            whole.item(number, RECEIVED),
            real.item(number, FIRST_S),
            real.item(number, LAST_S),
            whole.item(number, COUNT),
        )

    def corrected_ahead(self, messages: Wholes) -> list[bytes]:
        """Whole messages of corrected rates, of those that go on; empty where a rate is beyond the wire's range."""
        parts = np.zeros((len(messages), 4), np.int64)
        parts[:, 0], parts[:, 2], parts[:, 3] = messages, self._whole[messages, COUNT], self._places[messages]
        return self._corrected(parts, *self._senders.said)

    def corrected(self, parts: Sequence[tuple[Come, Correction, int, int]]) -> list[bytes]:
        """Samples of batches, from the first to the last, as messages of corrected ones have them (see Stencil).

        Empty where a rate is beyond the wire's range.
        """
        m = len(parts)
        which = np.array([(come.number, *cut, i) for i, (come, _, *cut) in enumerate(parts)], np.int64).reshape(m, 4)
        parameters = np.concatenate([correction.parameters for _, correction, _, _ in parts]).reshape(m, 12)
        return self._corrected(which, parameters, np.zeros((m, 2), np.uint64), _BARE)

    def _corrected(
        self, parts: Wholes, parameters: Floats, lengths: NDArray[np.uint64], begins: NDArray[np.uint8]
    ) -> list[bytes]:
        m, samples = len(parts), int((parts[:, 2] - parts[:, 1]).sum())
        packed = np.empty(m * (MOST_OF_ONE + begins.shape[1]) + _CORRECTED * samples, np.uint8)
        ends = np.empty(m, np.int64)
        came = self._packed, self._whole, self._real, self._rows
        corrected(*came, parts, parameters, lengths, begins, MAX_CORRECTED, packed, ends)
        places = [0, *ends.tolist()]
        said = packed[: places[-1]].tobytes()
        return [said[begin:end] for begin, end in pairwise(places)]
