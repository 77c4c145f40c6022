"""Ownership of devices by rendezvous hashing, and the epoch of a takeover. Pure.

Every estimator must reach the same answer by itself, although each may have heard of different devices. So shares are
not counted, and are as even as chance makes them (300 devices on three estimators: 100 ± 8 each).

An epoch is higher than every epoch heard of, so that an owner loses against its successor. It is no lower than the
time, so that estimators that all restarted and have heard of nothing continue above what subscribers know. Its last
bits are the estimator's own, so that two estimators on opposite sides of a cut network take one device under different
epochs.
"""

from collections.abc import Collection
from functools import lru_cache
from hashlib import blake2b
from zlib import crc32

from bridge.wire.validation import MAX_EPOCH

_OWN_BITS = 16
OWN = (1 << _OWN_BITS) - 1
#: no clock and no number of takeovers reaches this epoch: a higher one is wrong, and could soon not be exceeded
BEYOND = MAX_EPOCH // 4


def owner(device: str, estimators: Collection[str]) -> str:
    """The estimator that owns a device, of at least one. When an estimator comes or goes only its devices move."""
    return max(estimators, key=lambda name: (_weight(name, device), name))


@lru_cache(maxsize=1 << 16)
def _weight(estimator: str, device: str) -> int:
    # Python's own hash differs between processes. No id contains the separating byte.
    digest = blake2b(f"{estimator}\0{device}".encode(), digest_size=8).digest()
    return int.from_bytes(digest)


def epoch_after(highest: int, now_ns: int, estimator: str) -> int:
    """Epoch of a takeover at now_ns, by a clock that may be wrong, when `highest` is the highest epoch heard of."""
    turn = max(highest >> _OWN_BITS, now_ns // 1_000_000) + 1
    return min(turn << _OWN_BITS | own_bits(estimator), MAX_EPOCH)


def own_bits(estimator: str) -> int:
    """Last bits of an epoch, which distinguish one estimator's epochs from another's."""
    return crc32(estimator.encode()) & OWN
