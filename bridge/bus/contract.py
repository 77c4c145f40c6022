"""Bus interface: publish, subscribe, query and liveliness, independent of zenoh.

`zenoh_bus` implements this interface, and so does the in-memory bus of the tests. One test suite checks both.

Every method may be called from any thread. A handler given to `answer` or `watch_alive` runs on a thread of the bus.
The handler must return quickly and must not raise; an exception is logged. No method blocks longer than its timeout.
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
    """Error of a bus operation. The message states the operation, the endpoint or key, and the remedy."""


class Publisher(Protocol):
    """Publisher of messages on one bus key; the key has no wildcards."""

    def put(self, payload: bytes) -> None:
        """Send one message. Raises BusError after close.

        payload: bytes of the message. A subscriber that does not read delays the call by about 0.1 s at most; then the
        router disconnects it.
        """

    @property
    def wanted(self) -> bool:
        """True if a subscriber exists now, or if the publisher has a cache.

        False means that a message sent now reaches no reader. A publisher with a cache is always wanted, because late
        subscribers read the cache.
        """

    def close(self) -> None:
        """End the publisher and its cache: nothing more is sent, and queries to the cache get no answer. May be repeated."""


class Declared(Protocol):
    """Handle of a query handler, a liveliness token or a liveliness watcher; `close` removes it from the bus."""

    def close(self) -> None:
        """Remove the query handler, token or watcher from the bus; a second close does nothing."""


class Bus(Protocol):
    """Session on the message bus: publishes, subscribes, sends and answers queries, and declares liveliness tokens.

    A context manager: leaving the `with` block closes the session.
    """

    def publisher(self, key: str, *, cache: int = 0) -> Publisher:
        """Create a publisher on a key without wildcards.

        cache: number of latest messages to keep for late or reconnected subscribers; 0 for no cache.
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
        """Subscribe to one key pattern, or to several that do not overlap; all messages go into one queue.

        history: first deliver the messages in publishers' caches. Messages lost later in an outage are fetched from the
        caches too.
        capacity: number of messages the queue holds. A full queue drops its oldest messages and counts them in
        `missed`.
        Messages fetched from caches are never dropped.
        most_past: number of newest cached messages to fetch from each publisher; None for all.
        prompt: True uses a thread for this subscription and delivers at once. False shares the session's thread and
        delivers within about 25 ms.
        """

    def answer(self, pattern: str, handler: Callable[[str, bytes, Reply], None]) -> Declared:
        """Answer queries on keys that match a pattern, by calling handler(key, payload, reply) for each query.

        The handler calls reply(bytes), at once or later. An exception in the handler is sent to the querying program as
        an error.
        Closing the returned handle removes the handler.
        """

    def ask(self, key: str, payload: bytes, timeout_s: float = 2.0) -> bytes:
        """Send a query to a key and return the payload of the first answer that is not empty.

        Several programs may answer; an empty answer means that the query is meant for another program.
        Raises BusError if no such answer arrives within timeout_s seconds.
        """

    def declare_alive(self, key: str) -> Declared:
        """Declare a liveliness token: other sessions see the key as alive until the handle or this session closes."""

    def watch_alive(self, pattern: str, on_change: Callable[[str, bool], None]) -> Declared:
        """Watch liveliness tokens: call on_change(key, alive) for every token that exists now and for every later change.

        alive: True when a token appears, False when it disappears. Closing the returned handle ends the watch.
        """

    @property
    def connected(self) -> bool:
        """True if the session is connected to a router (or to the in-memory broker) now."""

    def close(self) -> None:
        """Close the session with all its publishers, subscriptions, handlers and tokens; a second close does nothing."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...
