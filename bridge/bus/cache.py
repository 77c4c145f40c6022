"""What publishers sent lately: numbered, kept, and told to subscribers that come later or have lost some of it.

A message of a publisher with a cache carries 20 bytes in its attachment: 8 random ones of its session, 4 of the publisher in
it, and 8 with the number of the message, from 0 on. Caches answer queries on `KEY/@adv/SESSION`, KEY a pattern, SESSION the
eight bytes in hex or `*`; the chunk `@adv` is where routers' rules let who may publish KEY answer, and who may hear it ask.
Without parameters all that is kept comes, one reply a message; `most=N` is the last N of each publisher; `publisher=P;from=N`
all of one publisher from a number on; `last=S` the attachment alone of the newest message, of publishers that sent one within S
seconds and have paused since.

A session answers once for all its keys that differ in the last chunk only, on `PLACE/*/@adv/SESSION`: a router's rules must let
it, as they do for every kind but `owned`.
"""

import time
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from bridge.bus.keyexpr import matches

SESSION_BYTES, IDENTITY_BYTES, STAMP_BYTES = 8, 12, 20
#: the chunk between a key and whose cache is meant
HISTORY = "@adv"
PARAMETERS = ("most", "publisher", "from", "last")
#: a publisher that put nothing for so long has paused: no next message will soon tell that the last was lost
PAUSED_S = 1.5

#: number and payload
Kept = tuple[int, bytes]


class Source(NamedTuple):
    """A publisher: its key, because a publisher of one key may claim the identity of another, and its identity."""

    key: str
    identity: bytes

    @property
    def place(self) -> str:
        """Where its session's caches of this key are asked."""
        return f"{self.key}/{HISTORY}/{self.identity[:SESSION_BYTES].hex()}"

    @property
    def publisher(self) -> int:
        """Which publisher of its session it is."""
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
        """The message that was just sent."""
        self._kept.append((self.next, payload))
        self.next += 1
        self._put_s = time.monotonic()

    def found(self, asked: Mapping[str, str]) -> Iterable[Kept]:
        """What a query with these parameters asks of this publisher; ValueError where they mean nothing."""
        kept = list(self._kept)
        if "last" in asked:
            paused_s = time.monotonic() - self._put_s
            return [(kept[-1][0], b"")] if kept and PAUSED_S <= paused_s <= float(asked["last"]) else []
        if "publisher" in asked:
            first = int(asked["from"])
            return [one for one in kept if one[0] >= first] if int(asked["publisher"]) == self._publisher else []
        return kept[-int(asked["most"]) :] if "most" in asked else kept


class Caches:
    """Those of one session, by the place below which they are asked: the key without its last chunk."""

    def __init__(self) -> None:
        self._by_key: dict[str, dict[str, list[Cache]]] = defaultdict(lambda: defaultdict(list))

    def add(self, cache: Cache) -> str | None:
        """Keep one; the place, if it is new."""
        place = place_of(cache.key)
        new = place not in self._by_key
        self._by_key[place][cache.key].append(cache)
        return place if new else None

    def discard(self, cache: Cache) -> None:
        """Its publisher was closed."""
        keys = self._by_key[place_of(cache.key)]
        keys[cache.key].remove(cache)
        if not keys[cache.key]:
            del keys[cache.key]

    def found(self, place: str, pattern: str, asked: Mapping[str, str]) -> Iterator[tuple[Cache, Kept]]:
        """All that a query on a pattern of keys asks for; ValueError where its parameters mean nothing."""
        keys = self._by_key[place]
        for key in list(keys) if "*" in pattern else [pattern]:
            if matches(pattern, key):
                for cache in list(keys.get(key, ())):
                    for kept in cache.found(asked):
                        yield cache, kept


def place_of(key: str) -> str:
    """Below it all keys of a kind lie; empty for a key of one chunk."""
    return key.rpartition("/")[0]
