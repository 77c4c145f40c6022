"""The bounded queue between the bus, which must never wait, and a reader, which may be slow."""

import threading
from collections import Counter, deque
from collections.abc import Iterable, Sequence

from bridge.bus.contract import Message

MOST_KEYS = 1024


class MessageQueue:
    """First in, first out; when full the oldest make room and are counted as missed.

    The past, from publishers' caches, has room of its own until it is read: a large ward's is more than a short queue holds.
    """

    def __init__(self, capacity: int) -> None:
        if capacity < 1:
            raise ValueError(f"a queue of {capacity} messages holds nothing; give 1 or more")
        self._capacity = capacity
        self._messages: deque[Message] = deque()
        self._past = 0  # of them at most
        self._ready = threading.Condition()
        self._missed: Counter[str] = Counter()
        self._overflowed = 0
        self._over = self._woken = False

    def put(self, messages: Iterable[Message], *, past: bool = False) -> None:
        """Take messages in, of the past or of now; never waits. After close they are discarded."""
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
        """Count messages that are known to have been lost before they came here, and under which key if it is known."""
        with self._ready:
            self._count(key, count)

    @property
    def missed(self) -> int:
        """How many messages are known to be lost so far."""
        return self._missed.total()

    @property
    def missed_by_key(self) -> dict[str, int]:
        """Missed messages by key, of up to MOST_KEYS keys; the others under ""."""
        with self._ready:
            return {key: n for key, n in self._missed.items() if n}

    @property
    def overflowed(self) -> int:
        """How many of them were here and made room."""
        return self._overflowed

    @property
    def closed(self) -> bool:
        """Whether close() was called."""
        return self._over

    def receive(self, timeout_s: float) -> Message | None:
        """The next message, or None when none came in time or the queue is closed."""
        taken = self.drain(1, timeout_s)
        return taken[0] if taken else None

    def drain(self, limit: int, timeout_s: float) -> list[Message]:
        """Wait up to timeout_s for a first message, then take up to limit without waiting."""
        with self._ready:
            if timeout_s > 0.0:
                self._ready.wait_for(lambda: self._messages or self._over or self._woken, timeout_s)
            self._woken = False
            taken = min(limit, len(self._messages))
            self._past = max(0, self._past - taken)
            return [self._messages.popleft() for _ in range(taken)]

    def wake(self) -> None:
        """A reader that waits, or the next one that would, goes on with nothing."""
        with self._ready:
            self._woken = True
            self._ready.notify_all()

    def _count(self, key: str, n: int) -> None:
        self._missed[key if key in self._missed or len(self._missed) < MOST_KEYS else ""] += n

    def close(self) -> None:
        """Discard what is here and wake every reader; a second close does nothing."""
        with self._ready:
            self._over = True
            self._messages.clear()
            self._ready.notify_all()


def newest_last(pasts: Iterable[Sequence[Message]]) -> list[Message]:
    """Messages of several keys, each key in its order and the newest of all keys last."""
    by_key: dict[str, list[Message]] = {}
    for past in pasts:
        by_key.setdefault(past[0].key, []).extend(past)
    aged = [(len(of) - n, message) for of in by_key.values() for n, message in enumerate(of)]
    return [message for _, message in sorted(aged, key=lambda one: -one[0])]
