"""Epochs: whose turn at a device is the later one. Pure.

An epoch is higher than every epoch that was heard of: a turn that is over loses against the one that follows it. It is no
lower than the time: estimators that were all started anew, and have heard of nothing, go on above what subscribers know. Its
last bits are the estimator's own: two that take one device at once, each on its side of a cut network, still differ.
"""

from zlib import crc32

from bridge.wire.checks import MAX_EPOCH

_OWN_BITS = 16
OWN = (1 << _OWN_BITS) - 1
#: no clock shows as much, and no turns come to it: who says so is wrong, and soon nobody could go above it
BEYOND = MAX_EPOCH // 4


def epoch_after(highest: int, now_ns: int, estimator: str) -> int:
    """The epoch of a turn that begins at now_ns, by a clock that may be wrong, when `highest` was heard of."""
    turn = max(highest >> _OWN_BITS, now_ns // 1_000_000) + 1
    return min(turn << _OWN_BITS | own_bits(estimator), MAX_EPOCH)


def own_bits(estimator: str) -> int:
    """What tells an estimator's epochs from another's."""
    return crc32(estimator.encode()) & OWN
