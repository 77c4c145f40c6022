"""Publisher cache: numbers messages and keeps the last ones, for late subscribers and for gap repair.

Each message carries an attachment of 20 bytes: session id (8, random), publisher number in the session (4), and message
number (8). Both numbers count from 0 and are big-endian.

A cache answers queries on `KEY/@adv/SESSION` with one reply per message. KEY is a key or pattern; SESSION is the
session id in hexadecimal, or `*`. A program with the right to publish on KEY may answer on these keys. A program with
the right to subscribe to KEY may send queries there. A query without parameters returns all messages. The parameters
are:

- `most=N`: the last N messages of each publisher
- `publisher=P;from=N`: the messages of publisher P from number N on
- `last=S`: the number of the newest message, in a reply without payload, if this message is 1.5 to S seconds old

A session declares one zenoh queryable, `PLACE/*/@adv/SESSION`, for all its keys that differ only in the last chunk.
PLACE is such a key without its last chunk. The router's access rules allow this queryable for all kinds of messages in
`bridge.wire.keys` except `owned`.
"""

import time
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from bridge.bus.key_expressions import matches

SESSION_BYTES, IDENTITY_BYTES, STAMP_BYTES = 8, 12, 20
#: chunk between the key and the session in a cache's key
HISTORY = "@adv"
PARAMETERS = ("most", "publisher", "from", "last")
#: a publisher silent for this time, s, has paused: no next message will soon reveal the loss of the last one
PAUSED_S = 1.5

#: a cached message: number and payload
Kept = tuple[int, bytes]


class Source(NamedTuple):
    """Identity of a publisher: its key, and 12 bytes (8 of the session, 4 of the publisher number).

    The key is part of the identity, so that a publisher cannot claim the number sequence of another key.
    """

    key: str
    identity: bytes

    @property
    def place(self) -> str:
        """Key on which this publisher's cache answers queries: `KEY/@adv/SESSION`, with the session id in hexadecimal."""
        return f"{self.key}/{HISTORY}/{self.identity[:SESSION_BYTES].hex()}"

    @property
    def publisher(self) -> int:
        """Number of the publisher within its session, counted from 0."""
        return int.from_bytes(self.identity[SESSION_BYTES:], "big")


class Cache:
    """Cache of the last `size` messages of one publisher, and the counter of its message numbers.

    key: the publisher's key. session: 8 random bytes of the session. publisher: number of the publisher in the session.
    next: number that the publisher's next message will have; the first message has the number 0.
    """

    def __init__(self, key: str, size: int, session: bytes, publisher: int) -> None:
        self.key, self.size, self._publisher = key, size, publisher
        self._identity = session + publisher.to_bytes(IDENTITY_BYTES - SESSION_BYTES, "big")
        self.next = 0
        self._kept = deque[Kept](maxlen=size)
        self._put_s = 0.0

    def stamp(self, number: int) -> bytes:
        """Return the 20-byte attachment of the message with this number: session id, publisher number, message number."""
        return self._identity + number.to_bytes(STAMP_BYTES - IDENTITY_BYTES, "big")

    def keep(self, payload: bytes) -> None:
        """Store the payload of the message that was just sent with the number `next`; then add 1 to `next`."""
        self._kept.append((self.next, payload))
        self.next += 1
        self._put_s = time.monotonic()

    def found(self, asked: Mapping[str, str]) -> Iterable[Kept]:
        """Return the cached messages (number, payload) that the query parameters select.

        asked: query parameters by name; the docstring of this module explains them. Raises ValueError for a parameter
        that is not a number.
        """
        kept = list(self._kept)
        if "last" in asked:
            paused_s = time.monotonic() - self._put_s
            return [(kept[-1][0], b"")] if kept and PAUSED_S <= paused_s <= float(asked["last"]) else []
        if "publisher" in asked:
            first = int(asked["from"])
            return [one for one in kept if one[0] >= first] if int(asked["publisher"]) == self._publisher else []
        return kept[-int(asked["most"]) :] if "most" in asked else kept


class Caches:
    """Caches of one session, grouped by place: the key without its last chunk."""

    def __init__(self) -> None:
        self._by_key: dict[str, dict[str, list[Cache]]] = defaultdict(lambda: defaultdict(list))

    def add(self, cache: Cache) -> str | None:
        """Add a cache. Return its place (key without the last chunk) if it is the first cache there, else None."""
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
        """Yield (cache, (number, payload)) for each cached message that a query selects.

        place: key without its last chunk. pattern: key or key pattern of the query. asked: query parameters, by name.
        Raises ValueError for a parameter that is not a number.
        """
        keys = self._by_key[place]
        for key in list(keys) if "*" in pattern else [pattern]:
            if matches(pattern, key):
                for cache in list(keys.get(key, ())):
                    for kept in cache.found(asked):
                        yield cache, kept


def place_of(key: str) -> str:
    """Return the place of a cache: its key without the last chunk; "" for a key of one chunk."""
    return key.rpartition("/")[0]
