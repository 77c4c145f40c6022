"""Publishers' caches: messages are numbered and the last ones kept, for subscribers that come late or have lost some.

The attachment of a message has 20 bytes: 8 random ones of the session, 4 of the publisher in the session, and 8 of the message's
number, counted from 0; both numbers are big-endian. A cache answers queries on `KEY/@adv/SESSION`, one reply a message: KEY is a
key or pattern, SESSION the session's bytes in hex, or `*`. Routers' rules let whoever may publish KEY answer below `@adv`, and
whoever may hear KEY ask there. A query has one of these parameters, or none for all messages:

- `most=N`: the last N messages of each publisher
- `publisher=P;from=N`: the messages of publisher P from number N on
- `last=S`: the newest message without its payload, of publishers that sent it within S seconds and have paused since

A session declares one queryable for all keys that differ in the last chunk only, `PLACE/*/@adv/SESSION`. A router must let it do
so; the rules do, for every kind of message but `owned`.
"""

import time
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from bridge.bus.key_expressions import matches

SESSION_BYTES, IDENTITY_BYTES, STAMP_BYTES = 8, 12, 20
#: the chunk between the key and the session
HISTORY = "@adv"
PARAMETERS = ("most", "publisher", "from", "last")
#: a publisher that sent nothing for so long has paused: no next message soon shows that the last one was lost
PAUSED_S = 1.5

#: number and payload
Kept = tuple[int, bytes]


class Source(NamedTuple):
    """A publisher: its key, because a publisher of one key may claim the identity of another, and its identity."""

    key: str
    identity: bytes

    @property
    def place(self) -> str:
        """The key on which this publisher's cache answers."""
        return f"{self.key}/{HISTORY}/{self.identity[:SESSION_BYTES].hex()}"

    @property
    def publisher(self) -> int:
        """Number of the publisher in its session."""
        return int.from_bytes(self.identity[SESSION_BYTES:], "big")


class Cache:
    """The last messages of one publisher."""

    def __init__(self, key: str, size: int, session: bytes, publisher: int) -> None:
        self.key, self.size, self._publisher = key, size, publisher
        self._identity = session + publisher.to_bytes(IDENTITY_BYTES - SESSION_BYTES, "big")
        self.next = 0
        self._kept = deque[Kept](maxlen=size)
        self._put_s = 0.0

    def stamp(self, number: int) -> bytes:
        """The attachment of the message with this number."""
        return self._identity + number.to_bytes(STAMP_BYTES - IDENTITY_BYTES, "big")

    def keep(self, payload: bytes) -> None:
        """Keep the message that was just sent, and count it."""
        self._kept.append((self.next, payload))
        self.next += 1
        self._put_s = time.monotonic()

    def found(self, asked: Mapping[str, str]) -> Iterable[Kept]:
        """Messages that a query with these parameters asks for; ValueError where a parameter is no number."""
        kept = list(self._kept)
        if "last" in asked:
            paused_s = time.monotonic() - self._put_s
            return [(kept[-1][0], b"")] if kept and PAUSED_S <= paused_s <= float(asked["last"]) else []
        if "publisher" in asked:
            first = int(asked["from"])
            return [one for one in kept if one[0] >= first] if int(asked["publisher"]) == self._publisher else []
        return kept[-int(asked["most"]) :] if "most" in asked else kept


class Caches:
    """Caches of one session, by place: the key without its last chunk."""

    def __init__(self) -> None:
        self._by_key: dict[str, dict[str, list[Cache]]] = defaultdict(lambda: defaultdict(list))

    def add(self, cache: Cache) -> str | None:
        """Add a cache; returns its place if no other cache is there yet."""
        place = place_of(cache.key)
        new = place not in self._by_key
        self._by_key[place][cache.key].append(cache)
        return place if new else None

    def discard(self, cache: Cache) -> None:
        """Remove the cache of a closed publisher."""
        keys = self._by_key[place_of(cache.key)]
        keys[cache.key].remove(cache)
        if not keys[cache.key]:
            del keys[cache.key]

    def found(self, place: str, pattern: str, asked: Mapping[str, str]) -> Iterator[tuple[Cache, Kept]]:
        """Messages that a query on a key or pattern asks for; ValueError where a parameter is no number."""
        keys = self._by_key[place]
        for key in list(keys) if "*" in pattern else [pattern]:
            if matches(pattern, key):
                for cache in list(keys.get(key, ())):
                    for kept in cache.found(asked):
                        yield cache, kept


def place_of(key: str) -> str:
    """The key without its last chunk; empty for a key of one chunk."""
    return key.rpartition("/")[0]
