"""The bus contract: publish, subscribe, query and liveliness, independent of zenoh.

`zenoh_bus` implements the contract, and so does the in-memory bus of the tests. One test suite checks both.

Threads: every method may be called from any thread. A handler given to `answer` or `watch_alive` runs on a thread of
the bus. The handler must be quick and must not raise; an exception is logged. No method blocks longer than
its timeout.
"""

from collections.abc import Callable, Sequence
from typing import Protocol, Self

from bridge.bus.message_queue import Message, MessageQueue

__all__ = ["Bus", "BusError", "Declared", "Message", "Publisher", "Reply", "Subscription"]

#: queue of received messages: in the order of each publisher, each message exactly once
Subscription = MessageQueue

#: sends the answer to a query, at any time and from any thread; an empty answer leaves the query to another program
Reply = Callable[[bytes], None]


class BusError(Exception):
    """A bus operation failed. The message says what was tried, where, and what to do."""


class Publisher(Protocol):
    """Sends messages on one key of the bus; the key has no wildcards."""

    def put(self, payload: bytes) -> None:
        """Send a payload; a slow reader never blocks the call. Raises BusError after close."""

    @property
    def wanted(self) -> bool:
        """True if a subscriber exists now, so that sending is worth the work.

        Always true with a cache, because late subscribers read the cache.
        """

    def close(self) -> None:
        """End the publisher: it sends no more and its cache is no longer answered for; a second close does nothing."""


class Declared(Protocol):
    """Handle of a declaration on the bus: query handler, liveliness token or watcher; closing it undeclares it."""

    def close(self) -> None:
        """End the declaration on the bus; a second close does nothing."""


class Bus(Protocol):
    """Session on the bus: publishes, subscribes, asks and answers queries, and declares liveliness tokens.

    A context manager, which closes the session at the end of the `with` block.
    """

    def publisher(self, key: str, *, cache: int = 0) -> Publisher:
        """Declare a publisher on a key without wildcards.

        cache: number of the last messages to keep for late and returning subscribers; 0 for none.
        """

    def subscribe(
        self,
        patterns: str | Sequence[str],
        *,
        history: bool = False,
        capacity: int = 65536,
        most_past: int | None = None,
        prompt: bool = True,
    ) -> Subscription:
        """Subscribe to one pattern, or to several that do not overlap, with one queue for all.

        history: cached messages come first, and messages lost in an outage are fetched from publishers' caches.
        capacity: messages the queue holds. A full queue drops its oldest messages and counts them in `missed`; messages
        from caches are never dropped.
        most_past: the number of cached messages to fetch from each publisher, the newest ones; None for all.
        prompt: a dedicated thread delivers each message at once. Otherwise the session's thread delivers within about 25 ms.
        """

    def answer(self, pattern: str, handler: Callable[[str, bytes, Reply], None]) -> Declared:
        """Answer queries on matching keys by handler(key, payload, reply), which calls reply(bytes) at once or later.

        An exception of the handler is sent to the asker as an error. Closing the returned handle ends the answering.
        """

    def ask(self, key: str, payload: bytes, timeout_s: float = 2.0) -> bytes:
        """Send a query (key and payload) and return the payload of the first answer that is not empty.

        Several programs may answer. An empty answer means that the query is for another program.
        Raises BusError when no such answer comes within timeout_s seconds.
        """

    def declare_alive(self, key: str) -> Declared:
        """Declare a liveliness token: other sessions see the key as alive until the handle or the session closes."""

    def watch_alive(self, pattern: str, on_change: Callable[[str, bool], None]) -> Declared:
        """Watch liveliness tokens: call on_change(key, alive) for every present token and for every later change.

        alive is true when a token appears, false when it goes. Closing the returned handle ends the watch.
        """

    @property
    def connected(self) -> bool:
        """True if a router (or the in-memory broker) is connected now."""

    def close(self) -> None:
        """Close the session on the bus and all its declarations; a second close does nothing."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...
