"""Unwraps a device's tick counter and sequence numbers, and finds missing, repeated and overtaken samples."""

from operator import lt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.drivers.driver import Identity, Readings

Counts = NDArray[np.int64]
_REMEMBERED = 256  # missing numbers that may still come
_FAR = 2**62  # ticks: of more, int64 has no room for a turn


class Counters:
    """The latest sequence number and tick of one boot, unwrapped."""

    def __init__(self) -> None:
        self._sequence: int | None = None
        self._ticks = 0
        self._missed: dict[int, bool] = {}  # numbers that were passed over, oldest first

    def unwrapped(self, readings: Readings, identity: Identity) -> tuple[Counts, Counts]:
        """Sequence numbers and ticks that go on, (n,) each; they may repeat or go back, as sent."""
        if self._sequence is None:
            first = readings.sequence % 2**identity.sequence_bits
            origin = int(readings.ticks[0]) % 2**identity.tick_bits
            tick_steps = steps(readings.ticks, origin, identity.tick_bits)
        else:
            forward = step(readings.sequence, self._sequence, identity.sequence_bits)
            if forward == 1 and (ticks := self._rising(readings.ticks, identity.tick_bits)) is not None:
                return self._sequence + 1 + np.arange(len(ticks)), ticks
            first, origin = self._sequence + forward, self._ticks
            tick_steps = steps(readings.ticks, origin, identity.tick_bits)
            # After a long silence the ticks may have gone round unseen; the sequence knows how long it was.
            expected = forward / (identity.rate_hz * identity.tick_period_s)
            if abs(expected) > 2 ** (identity.tick_bits - 2):
                tick_steps[0] = whole_turns(int(tick_steps[0]), expected, identity.tick_bits)
        return first + np.arange(len(readings.ticks)), origin + np.cumsum(tick_steps)

    def going_on(self, readings: Readings, identity: Identity) -> tuple[int, Counts] | None:
        """The first number and the ticks (n,) of readings that are all new: the next in number, and rising. Moves nothing."""
        if self._sequence is None or step(readings.sequence, self._sequence, identity.sequence_bits) != 1:
            return None
        ticks = self._rising(readings.ticks, identity.tick_bits)
        return None if ticks is None else (self._sequence + 1, ticks)

    def went_on(self, first: int, ticks: Counts) -> None:
        """Move on over what goes on."""
        self._sequence, self._ticks = first + len(ticks) - 1, int(ticks[-1])

    def _rising(self, counts: NDArray[np.unsignedinteger], bits: int) -> Counts | None:
        """The ticks, if they only rise, and did not go round: which is almost always, and costs little."""
        sent, turn = counts.tolist(), 1 << bits
        before = self._ticks - self._ticks % turn
        last = before + sent[-1]
        rising = self._ticks < before + sent[0] and last < min(self._ticks + turn // 2, _FAR)
        return counts.astype(np.int64) + before if rising and all(map(lt, sent, sent[1:])) else None

    def follow(self, sequence: Counts, ticks: Counts) -> "Followed":
        """Which samples (n,) are new, and what the others are; moves on to the last new one."""
        last = -1 if self._sequence is None else self._sequence
        if int(sequence[0]) == last + 1 and int(ticks[0]) > self._ticks and last >= 0 and _rise(ticks):
            self._sequence, self._ticks = int(sequence[-1]), int(ticks[-1])
            return Followed(np.ones(len(ticks), bool), 0)
        unheard = sequence > last
        rising = np.ones(len(ticks), bool) if self._sequence is None else ticks > self._ticks
        # Within the readings ticks must rise above all before them.
        rising[1:] &= ticks[1:] > np.maximum.accumulate(ticks)[:-1]
        new = unheard & rising
        missing = 0
        if new.any():
            if self._sequence is not None and sequence[0] > last + 1:
                missing = int(sequence[0]) - last - 1
                self._miss(range(last + 1, int(sequence[0])))
            latest = int(np.flatnonzero(new)[-1])
            self._sequence, self._ticks = int(sequence[latest]), int(ticks[latest])
        if new.all():
            return Followed(new, missing)
        overtaken = [self._missed.pop(int(number), False) for number in sequence[~unheard]]
        backward, repeated = int(np.count_nonzero(unheard & ~rising)), len(overtaken) - sum(overtaken)
        return Followed(new, missing, repeated, sum(overtaken), backward)

    def _miss(self, numbers: range) -> None:
        self._missed.update(dict.fromkeys(numbers[-_REMEMBERED:], True))
        while len(self._missed) > _REMEMBERED:
            del self._missed[next(iter(self._missed))]


class Followed(NamedTuple):
    """What samples of a boot are: new (n,), or one of three kinds that are counted; missing: numbers before the first.

    repeated: had before; overtaken: newer ones came first; backward: newly numbered, but of an earlier time.
    """

    new: NDArray[np.bool_]
    missing: int
    repeated: int = 0
    overtaken: int = 0
    backward: int = 0


def _rise(ticks: Counts) -> bool:
    return bool(np.logical_and.reduce(ticks[1:] > ticks[:-1]))


def steps(counts: NDArray[np.unsignedinteger], before: int, bits: int) -> Counts:
    """(n,) signed step from each count to the next, the first from `before`, each the shortest way round 2**bits."""
    all_counts = np.concatenate([np.array([before % 2**bits], np.uint64), counts.astype(np.uint64)])
    spare = np.uint64(64 - bits)
    # Left-aligned in 64 bits, so that the difference wraps at the counter's width and its top bit is the sign.
    aligned: NDArray[np.uint64] = all_counts << spare
    return (aligned[1:] - aligned[:-1]).view(np.int64) >> np.int64(64 - bits)


def step(count: int, before: int, bits: int) -> int:
    """As `steps`, of one count."""
    half = 1 << (bits - 1)
    return (count - before + half) % (1 << bits) - half


def whole_turns(step_: int, expected: float, bits: int) -> int:
    """A step with as many turns of the counter added as bring it nearest to what was expected."""
    return step_ + (1 << bits) * round((expected - step_) / (1 << bits))
