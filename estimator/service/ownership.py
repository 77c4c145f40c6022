"""Whose device it is: rendezvous hashing, of the estimators that are alive and of nothing else. Pure.

Every estimator must come to the same answer by itself, without having heard of the same devices as the others: so no shares
are counted, and they are as even as chance makes them (300 devices of three: 100 ± 8).
"""

from collections.abc import Collection
from functools import lru_cache
from hashlib import blake2b


def owner(device: str, estimators: Collection[str]) -> str:
    """Of estimators, one at least, the one whose device it is: of one that comes or goes only the devices move."""
    return max(estimators, key=lambda name: (_weight(name, device), name))


@lru_cache(maxsize=1 << 16)
def _weight(estimator: str, device: str) -> int:
    # Python's own hash is another in every process. No id has the byte between the two.
    digest = blake2b(f"{estimator}\0{device}".encode(), digest_size=8).digest()
    return int.from_bytes(digest)
