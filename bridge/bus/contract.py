"""What the rest of the program knows of a bus.

`zenoh_bus` keeps this contract, and so does the tests' in-memory bus; one suite holds both.

Threads: every method may be called from any thread. A handler given to `answer` or `watch_alive` runs on a thread of
the bus; it must be quick and must not raise (what it raises is logged and counted, never lost). Nothing here blocks
longer than its timeout.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol, Self


class Message(NamedTuple):
    """One sample off the bus, not yet parsed or trusted."""

    key: str
    payload: bytes


#: answers a query, at any time and from any thread; empty where the answer is somebody else's
Reply = Callable[[bytes], None]


class BusError(Exception):
    """The bus could not do it: what was tried, where, and what to do."""


class Publisher(Protocol):
    """A declared literal key."""

    def put(self, payload: bytes) -> None:
        """Send; never blocks on a slow reader. After close: BusError."""

    @property
    def wanted(self) -> bool:
        """Whether anybody subscribes now; of a publisher with a cache always: who comes later wants what was before."""

    def close(self) -> None:
        """Undeclare; a second close does nothing."""


class Subscription(Protocol):
    """Messages in a bounded queue, in order per publisher, each exactly once."""

    def receive(self, timeout_s: float) -> Message | None:
        """The next message, or None when none came in time or the subscription is closed."""

    def drain(self, limit: int, timeout_s: float) -> list[Message]:
        """Wait up to timeout_s for a first message, then take up to limit without waiting."""

    def wake(self) -> None:
        """End a wait in `drain` or `receive`, or the next one: its thread has something else to do."""

    @property
    def missed(self) -> int:
        """Messages known to be lost: reported by the bus, or dropped because this queue was full."""

    @property
    def missed_by_key(self) -> dict[str, int]:
        """Missed messages by key, of a bounded number of keys; under "" those whose key is not known."""

    @property
    def overflowed(self) -> int:
        """Those of them that were dropped because this queue was full: its reader is too slow."""

    @property
    def caught_up(self) -> bool:
        """Whether what caches held when this was declared has come, or was waited for long enough."""

    @property
    def closed(self) -> bool:
        """Nothing will ever come again, by close() here or because the bus was closed: a reading loop must end."""

    def close(self) -> None:
        """Stop; a second close does nothing."""


class Declared(Protocol):
    """Something declared on the bus that can be taken back."""

    def close(self) -> None:
        """Take it back; a second close does nothing."""


class Bus(Protocol):
    """One session on the bus."""

    def publisher(self, key: str, *, cache: int = 0) -> Publisher:
        """Declare a publisher. With cache > 0 the last `cache` messages are kept for late and returning subscribers."""

    def subscribe(
        self,
        patterns: str | Sequence[str],
        *,
        history: bool = False,
        capacity: int = 65536,
        most_past: int | None = None,
        prompt: bool = True,
    ) -> Subscription:
        """Receive what matches the pattern, or one of several that do not overlap, in one queue.

        With history, cached messages come first and losses during an outage are repaired.

        Of what a publisher's cache holds now the last most_past come, by default all. A full queue drops its oldest messages,
        and counts them in `missed`; of what caches held none is dropped.

        prompt: a thread of its own hands messages on as they come; without, the session's thread does within about 25 ms.
        """

    def answer(self, pattern: str, handler: Callable[[str, bytes, Reply], None]) -> Declared:
        """Answer queries on matching keys: handler(key, payload, reply) calls reply, then or later. What it raises is told."""

    def ask(self, key: str, payload: bytes, timeout_s: float = 2.0) -> bytes:
        """The first answer to a query that is not empty, of all who answer it: an empty one says that another is meant.

        Raises BusError when there is none.
        """

    def declare_alive(self, key: str) -> Declared:
        """A token others see for as long as this session lives."""

    def watch_alive(self, pattern: str, on_change: Callable[[str, bool], None]) -> Declared:
        """Call on_change(key, alive) for every token there is now and every change after."""

    @property
    def connected(self) -> bool:
        """Whether a router (or the memory broker) is there now."""

    def close(self) -> None:
        """Close the session and everything declared in it; a second close does nothing."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...
