"""Whose a device is, by rendezvous hashing, and under which epoch it is taken. Pure.

Every estimator must come to the same answer by itself, without having heard of the same devices as the others: so no shares
are counted, and they are as even as chance makes them (300 devices of three: 100 ± 8).

An epoch is higher than every epoch that was heard of: an owner loses against the one that follows. It is no lower than the
time: estimators that were all started anew, and have heard of nothing, go on above what subscribers know. Its last bits are
the estimator's own: two that take one device at once, each on its side of a cut network, still differ.
"""

from collections.abc import Collection
from functools import lru_cache
from hashlib import blake2b
from zlib import crc32

from bridge.wire.validation import MAX_EPOCH

_OWN_BITS = 16
OWN = (1 << _OWN_BITS) - 1
#: no clock shows as much, and no turns come to it: who says so is wrong, and soon nobody could go above it
BEYOND = MAX_EPOCH // 4


def owner(device: str, estimators: Collection[str]) -> str:
    """Of estimators, one at least, the one whose device it is: of one that comes or goes only the devices move."""
    return max(estimators, key=lambda name: (_weight(name, device), name))


@lru_cache(maxsize=1 << 16)
def _weight(estimator: str, device: str) -> int:
    # Python's own hash is another in every process. No id has the byte between the two.
    digest = blake2b(f"{estimator}\0{device}".encode(), digest_size=8).digest()
    return int.from_bytes(digest)


def epoch_after(highest: int, now_ns: int, estimator: str) -> int:
    """The epoch of a turn that begins at now_ns, by a clock that may be wrong, when `highest` was heard of."""
    turn = max(highest >> _OWN_BITS, now_ns // 1_000_000) + 1
    return min(turn << _OWN_BITS | own_bits(estimator), MAX_EPOCH)


def own_bits(estimator: str) -> int:
    """What tells an estimator's epochs from another's."""
    return crc32(estimator.encode()) & OWN
