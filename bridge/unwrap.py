"""Counters that wrap, made to go on: a device's ticks and sequence numbers."""

import numpy as np
from numpy.typing import NDArray


def steps(counts: NDArray[np.unsignedinteger], before: int, bits: int) -> NDArray[np.int64]:
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
