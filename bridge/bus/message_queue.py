"""Bounded message queue between the bus, which must never wait, and a reader, which may be slow."""

import threading
from collections import Counter, deque
from collections.abc import Iterable, Sequence
from typing import NamedTuple

MOST_KEYS = 1024


class Message(NamedTuple):
    """Message received from the bus: its key and its payload bytes, neither parsed nor validated."""

    key: str
    payload: bytes


class MessageQueue:
    """First-in-first-out queue of bus messages. A full queue drops its oldest messages and counts them as missed.

    capacity: largest number of live messages. History from publishers' caches does not count towards `capacity`,
    because the history of a large ward can exceed a short queue. Raises ValueError for a capacity below 1.
    """

    def __init__(self, capacity: int) -> None:
        if capacity < 1:
            raise ValueError(f"capacity is {capacity}: use 1 or more messages")
        self._capacity = capacity
        self._messages: deque[Message] = deque()
        self._past = 0  # history messages not read yet, at most
        self._ready = threading.Condition()
        self._missed: Counter[str] = Counter()
        self._overflowed = 0
        self._over = False

    def put(self, messages: Iterable[Message], *, past: bool = False) -> None:
        """Append messages without waiting: live messages, or history from caches (past=True).

        A closed queue discards the messages.
        """
        with self._ready:
            if self._over:
                return
            before = len(self._messages)
            self._messages.extend(messages)
            if past:
                self._past += len(self._messages) - before
            while len(self._messages) > self._capacity + self._past:
                self._count(self._messages.popleft().key, 1)
                self._overflowed += 1
            self._ready.notify_all()

    def add_missed(self, count: int, key: str = "") -> None:
        """Add `count` to the number of messages that were lost before they reached this queue.

        key: bus key of the lost messages; "" if unknown.
        """
        with self._ready:
            self._count(key, count)

    @property
    def missed(self) -> int:
        """Number of messages known to be lost, over all keys: lost in transit, or dropped because this queue was full."""
        return self._missed.total()

    @property
    def missed_by_key(self) -> dict[str, int]:
        """Number of lost messages by key, for up to MOST_KEYS keys; the messages of all other keys count under ""."""
        with self._ready:
            return {key: n for key, n in self._missed.items() if n}

    @property
    def overflowed(self) -> int:
        """Number of messages dropped because this queue was full, which happens when the reader is too slow."""
        return self._overflowed

    @property
    def closed(self) -> bool:
        """True if the queue is closed: it discards new messages and returns none, so a reading loop must end."""
        return self._over

    @property
    def caught_up(self) -> bool:
        """True if the history from publishers' caches has arrived or its query has timed out. Live messages follow."""
        return True

    def receive(self, timeout_s: float) -> Message | None:
        """Wait for the next message and return it; None after timeout_s seconds without one, or if the queue is closed."""
        taken = self.drain(1, timeout_s)
        return taken[0] if taken else None

    def drain(self, limit: int, timeout_s: float) -> list[Message]:
        """Wait up to timeout_s seconds for a first message, then return up to `limit` waiting messages; [] if none came."""
        with self._ready:
            if timeout_s > 0.0:
                self._ready.wait_for(lambda: self._messages or self._over, timeout_s)
            taken = min(limit, len(self._messages))
            self._past = max(0, self._past - taken)
            return [self._messages.popleft() for _ in range(taken)]

    def _count(self, key: str, n: int) -> None:
        self._missed[key if key in self._missed or len(self._missed) < MOST_KEYS else ""] += n

    def close(self) -> None:
        """Close the queue: discard all messages and wake every waiting reader; a second close does nothing."""
        with self._ready:
            self._over = True
            self._messages.clear()
            self._ready.notify_all()


def newest_last(pasts: Iterable[Sequence[Message]]) -> list[Message]:
    """Merge lists of messages into one list that ends with the newest message of every key.

    Example for the keys a and b: a1, a2, b2, a3, b3, with 3 for the newest. The messages of each key stay in order.
    pasts: lists that are not empty, each with messages of one key, oldest first.
    """
    by_key: dict[str, list[Message]] = {}
    for past in pasts:
        by_key.setdefault(past[0].key, []).extend(past)
    aged = [(len(of) - n, message) for of in by_key.values() for n, message in enumerate(of)]
    return [message for _, message in sorted(aged, key=lambda one: -one[0])]
