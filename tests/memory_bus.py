"""The bus without a network, for tests: the same contract inside one process, with outages on demand.

Repairs after an outage as publishers with a cache on zenoh do.
"""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from queue import Empty, SimpleQueue
from typing import Any, Self

from bridge.bus.contract import BusError, Message, Reply
from bridge.bus.key_expressions import check_key, check_pattern, check_patterns, matches
from bridge.bus.message_queue import MessageQueue

_log = logging.getLogger(__name__)


class MemoryBroker:
    """What the buses meet at; it stands for the router. Safe to use from any thread."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.running = True
        self.publishers: list[_Publisher] = []
        self.subscriptions: list[_Subscription] = []
        self.answerers: list[_Answerer] = []
        self.watchers: list[_Watcher] = []
        self.tokens: list[_Token] = []

    def stop(self) -> None:
        """Begin an outage: every bus is alone until start()."""
        with self.lock:
            self.running = False
            self.settle()

    def start(self) -> None:
        """End the outage; cached messages that subscribers with history missed are delivered now."""
        with self.lock:
            self.running = True
            self.settle()

    def settle(self) -> None:
        """Bring watchers and subscribers with history up to date after a change of who reaches whom."""
        for watcher in self.watchers:
            watcher.update()
        for subscription in self.subscriptions:
            for publisher in self.publishers:
                subscription.repair(publisher)


class MemoryBus:
    """A session at a broker. See contract.Bus."""

    def __init__(self, broker: MemoryBroker) -> None:
        self.broker = broker
        self._attached = True
        self._closed = False

    def publisher(self, key: str, *, cache: int = 0) -> "_Publisher":
        """See contract.Bus."""
        return _Publisher(self._open(), check_key(key), cache)

    def subscribe(
        self,
        patterns: str | Sequence[str],
        *,
        history: bool = False,
        capacity: int = 65536,
        most_past: int | None = None,
        prompt: bool = True,
    ) -> "_Subscription":
        """See contract.Bus."""
        inbox = _Subscription(self._open(), check_patterns(patterns), capacity, history=history)
        inbox.begin(most_past)
        return inbox

    def answer(self, pattern: str, handler: Callable[[str, bytes, Reply], None]) -> "_Answerer":
        """See contract.Bus."""
        return _Answerer(self._open(), check_pattern(pattern), handler)

    def ask(self, key: str, payload: bytes, timeout_s: float = 2.0) -> bytes:
        """See contract.Bus."""
        self._open()
        check_key(key)
        with self.broker.lock:
            able = [a for a in self.broker.answerers if self.reaches(a.bus) and matches(a.pattern, key)]
        if not able:
            raise BusError(f"no program answers {key!r}: check that the estimator runs (`truerate status`)")
        done = SimpleQueue[tuple[bytes, str]]()
        for one in able:
            one.tell(key, bytes(payload), done.put)
        deadline, errors = time.monotonic() + timeout_s, list[str]()
        while len(errors) < len(able):
            try:
                reply, error = done.get(timeout=max(0.0, deadline - time.monotonic()))
            except Empty:
                raise BusError(f"no answer to {key!r} within {timeout_s:g} s") from None
            if reply:
                return reply
            errors.append(error)
        raise BusError(f"{key!r} was answered with an error: {'; '.join(errors)}")

    def declare_alive(self, key: str) -> "_Token":
        """See contract.Bus."""
        return _Token(self._open(), check_key(key))

    def watch_alive(self, pattern: str, on_change: Callable[[str, bool], None]) -> "_Watcher":
        """See contract.Bus."""
        return _Watcher(self._open(), check_pattern(pattern), on_change)

    @property
    def connected(self) -> bool:
        """See contract.Bus."""
        return self._attached and self.broker.running and not self._closed

    def detach(self) -> None:
        """Begin an outage of this bus alone, for good."""
        with self.broker.lock:
            self._attached = False
            self.broker.settle()

    def reaches(self, other: "MemoryBus") -> bool:
        """Whether what happens in this bus is noticed in the other one; a bus always reaches itself."""
        return self is other or (self.connected and other.connected)

    def close(self) -> None:
        """See contract.Bus."""
        broker = self.broker
        with broker.lock:
            kinds = broker.publishers, broker.subscriptions, broker.answerers, broker.watchers, broker.tokens
            for declared in [one for kind in kinds for one in kind if one.bus is self]:
                declared.close()
            self._closed = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _open(self) -> Self:
        if self._closed:
            raise BusError("this bus is closed; open a new one")
        return self


class _Declared:
    """Something that is among others of its kind at the broker until it is closed."""

    def __init__(self, bus: MemoryBus, kind: list[Any]) -> None:
        self.bus, self.lock, self._kind = bus, bus.broker.lock, kind
        with self.lock:
            kind.append(self)
            self._changed()

    def close(self) -> None:
        with self.lock:
            if self in self._kind:
                self._kind.remove(self)
                self._changed()

    def _changed(self) -> None:
        """It came or went."""


class _Publisher(_Declared):
    def __init__(self, bus: MemoryBus, key: str, cache: int) -> None:
        self.key, self.cached, self._sequence = key, deque[tuple[int, Message]](maxlen=cache), 0
        super().__init__(bus, bus.broker.publishers)

    def put(self, payload: bytes) -> None:
        message = Message(self.key, bytes(payload))
        with self.lock:
            if self not in self._kind:
                raise BusError(f"the publisher of {self.key!r} is closed: open a new publisher")
            self._sequence += 1
            self.cached.append((self._sequence, message))
            for subscription in self.bus.broker.subscriptions:
                subscription.offer(self, self._sequence, message)

    @property
    def wanted(self) -> bool:
        with self.lock:
            return self.cached.maxlen != 0 or any(s.hears(self) for s in self.bus.broker.subscriptions)


class _Subscription(_Declared, MessageQueue):
    caught_up = True

    def __init__(self, bus: MemoryBus, patterns: tuple[str, ...], capacity: int, *, history: bool) -> None:
        MessageQueue.__init__(self, capacity)
        self._patterns, self._history, self._last = patterns, history, dict[_Publisher, int]()
        _Declared.__init__(self, bus, bus.broker.subscriptions)

    def begin(self, most_past: int | None) -> None:
        with self.lock:
            for publisher in self.bus.broker.publishers:
                past = self._news(publisher)
                self.put(past[-most_past:] if most_past else past, past=True)

    def offer(self, publisher: _Publisher, sequence: int, message: Message) -> None:
        if self.hears(publisher):
            self._last[publisher] = sequence
            self.put([message])

    def hears(self, publisher: _Publisher) -> bool:
        return publisher.bus.reaches(self.bus) and any(matches(pattern, publisher.key) for pattern in self._patterns)

    def repair(self, publisher: _Publisher) -> None:
        past = publisher not in self._last
        self.put(self._news(publisher), past=past)

    def _news(self, publisher: _Publisher) -> list[Message]:
        """What it has kept, and was not heard here."""
        if not (self._history and self.hears(publisher)):
            return []
        last = self._last.get(publisher)
        new = [(n, message) for n, message in publisher.cached if n > (last or 0)]
        if new:
            if last is not None:
                self.add_missed(new[0][0] - last - 1, publisher.key)
            self._last[publisher] = new[-1][0]
        return [message for _, message in new]

    def close(self) -> None:
        _Declared.close(self)
        MessageQueue.close(self)


class _Answerer(_Declared):
    def __init__(self, bus: MemoryBus, pattern: str, handler: Callable[[str, bytes, Reply], None]) -> None:
        self.pattern, self._handler = pattern, handler
        super().__init__(bus, bus.broker.answerers)

    def tell(self, key: str, payload: bytes, done: Callable[[tuple[bytes, str]], None]) -> None:
        try:
            self._handler(key, payload, lambda reply: done((reply, "an empty answer")))
        except Exception as error:  # noqa: BLE001 - as on zenoh
            _log.exception("the handler of queries on %s failed", key)
            done((b"", f"{type(error).__name__}: {error}"))


class _Token(_Declared):
    def __init__(self, bus: MemoryBus, key: str) -> None:
        self.key = key
        super().__init__(bus, bus.broker.tokens)

    def _changed(self) -> None:
        self.bus.broker.settle()


class _Watcher(_Declared):
    def __init__(self, bus: MemoryBus, pattern: str, on_change: Callable[[str, bool], None]) -> None:
        self._pattern, self._alive, self._changes = pattern, set[str](), SimpleQueue[tuple[str, bool] | None]()
        self._on_change = on_change
        super().__init__(bus, bus.broker.watchers)
        threading.Thread(target=self._run, name=f"watch {pattern}", daemon=True).start()

    def update(self) -> None:
        tokens = self.bus.broker.tokens
        alive = {t.key for t in tokens if t.bus.reaches(self.bus) and matches(self._pattern, t.key)}
        for key in sorted(self._alive ^ alive, key=lambda key: (key in alive, key)):
            self._changes.put((key, key in alive))
        self._alive = alive

    def _changed(self) -> None:
        if self in self._kind:
            self.update()
        else:
            self._changes.put(None)

    def _run(self) -> None:
        while change := self._changes.get():
            try:
                self._on_change(*change)
            except Exception:  # noqa: BLE001 - as on zenoh
                _log.exception("the handler of the liveliness of %s failed", self._pattern)
