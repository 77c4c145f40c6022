"""Unwraps a device's tick counter and sequence numbers, and finds missing, duplicate and late samples."""

from operator import lt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.drivers.driver import Identity, Readings

Counts = NDArray[np.int64]
_REMEMBERED = 256  # missing sequence numbers that may still arrive
_FAR = 2**62  # ticks; beyond, adding a turn could overflow int64


class CounterUnwrapper:
    """Unwraps the sequence numbers and ticks of one boot, and distinguishes new samples from repeated and late ones."""

    def __init__(self) -> None:
        self._sequence: int | None = None
        self._ticks = 0
        self._missed: dict[int, bool] = {}  # skipped sequence numbers, oldest first

    def unwrapped(self, readings: Readings, identity: Identity) -> tuple[Counts, Counts]:
        """Return (sequence numbers, ticks) of readings, (n,) int64 each, unwrapped as if the counters never wrapped.

        identity: gives the widths of the counters in bits. If samples arrive twice or late, the results repeat or fall.
        """
        if self._sequence is None:
            first = readings.sequence % 2**identity.sequence_bits
            origin = int(readings.ticks[0]) % 2**identity.tick_bits
            tick_steps = steps(readings.ticks, origin, identity.tick_bits)
        else:
            forward = step(readings.sequence, self._sequence, identity.sequence_bits)
            first, origin = self._sequence + forward, self._ticks
            tick_steps = steps(readings.ticks, origin, identity.tick_bits)
            # After a long silence the ticks may have wrapped unseen; the sequence number tells its length.
            expected = forward / (identity.rate_hz * identity.tick_period_s)
            if abs(expected) > 2 ** (identity.tick_bits - 2):
                tick_steps[0] = whole_turns(int(tick_steps[0]), expected, identity.tick_bits)
        return first + np.arange(len(readings.ticks)), origin + np.cumsum(tick_steps)

    def _rising(self, counts: NDArray[np.unsignedinteger], bits: int) -> Counts | None:
        """Unwrapped ticks by the fast path, if they only rise and did not wrap; None otherwise."""
        sent, turn = counts.tolist(), 1 << bits
        before = self._ticks - self._ticks % turn
        last = before + sent[-1]
        rising = self._ticks < before + sent[0] and last < min(self._ticks + turn // 2, _FAR)
        return counts.astype(np.int64) + before if rising and all(map(lt, sent, sent[1:])) else None

    def follow(self, readings: Readings, identity: Identity) -> "Followed":
        """Unwrap the counters of readings, and distinguish new samples from repeated and late ones.

        identity: gives the widths of the counters in bits. The last new sample becomes the reference for the next
        readings.
        """
        last = self._sequence
        if last is not None and step(readings.sequence, last, identity.sequence_bits) == 1:
            rising = self._rising(readings.ticks, identity.tick_bits)
            if rising is not None:
                self._sequence, self._ticks = last + len(rising), int(rising[-1])
                return Followed(last + 1, rising)
        sequence, ticks = self.unwrapped(readings, identity)
        unheard = sequence > (-1 if last is None else last)
        later = np.ones(len(ticks), bool) if last is None else ticks > self._ticks
        # Within the readings, a tick must exceed all earlier ticks.
        later[1:] &= ticks[1:] > np.maximum.accumulate(ticks)[:-1]
        new, first, missing = unheard & later, int(sequence[0]), 0
        if new.any():
            if last is not None and first > last + 1:
                missing = first - last - 1
                self._miss(range(last + 1, first))
            latest = int(np.flatnonzero(new)[-1])
            self._sequence, self._ticks = int(sequence[latest]), int(ticks[latest])
        overtaken = [self._missed.pop(int(number), False) for number in sequence[~unheard]]
        backward, repeated = int(np.count_nonzero(unheard & ~later)), len(overtaken) - sum(overtaken)
        return Followed(first, ticks, new, missing, repeated, sum(overtaken), backward)

    def _miss(self, numbers: range) -> None:
        self._missed.update(dict.fromkeys(numbers[-_REMEMBERED:], True))
        while len(self._missed) > _REMEMBERED:
            del self._missed[next(iter(self._missed))]


class Followed(NamedTuple):
    """Unwrapped readings of n samples: sequence number of the first sample, tick counts, and which samples are new.

    ticks (n,): device time in ticks. new (n,): True for new samples; None if all are new.
    missing: number of sequence numbers skipped before the first sample. repeated: number of samples that were received
    already. overtaken: number of samples that arrived after newer ones. backward: number of samples with a new sequence
    number but an earlier time.
    """

    first: int
    ticks: Counts
    new: NDArray[np.bool_] | None = None
    missing: int = 0
    repeated: int = 0
    overtaken: int = 0
    backward: int = 0


def steps(counts: NDArray[np.unsignedinteger], before: int, bits: int) -> Counts:
    """Return the signed steps (n,) int64 between consecutive counts (n,) of a counter of `bits` bits.

    The first step is from `before`. Each step is the shortest way around the 2**bits values of the counter.
    """
    all_counts = np.concatenate([np.array([before % 2**bits], np.uint64), counts.astype(np.uint64)])
    spare = np.uint64(64 - bits)
    # Left-aligned in 64 bits, so that the difference wraps at the counter's width and its top bit is the sign.
    aligned: NDArray[np.uint64] = all_counts << spare
    return (aligned[1:] - aligned[:-1]).view(np.int64) >> np.int64(64 - bits)


def step(count: int, before: int, bits: int) -> int:
    """Return the signed step from `before` to `count` of a counter of `bits` bits, the shortest way around its 2**bits values."""
    half = 1 << (bits - 1)
    return (count - before + half) % (1 << bits) - half


def whole_turns(step_: int, expected: float, bits: int) -> int:
    """Add whole turns of a counter to a step, so that the result is nearest to the expected step; return the result.

    A whole turn is 2**bits counts. step_, expected: steps in counts.
    """
    return step_ + (1 << bits) * round((expected - step_) / (1 << bits))
