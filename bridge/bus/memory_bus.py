"""The bus without a network: the same contract inside one process, with outages on demand.

For tests, replays and the demo on one machine. Repairs after an outage follow zenoh's advanced publishers.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from queue import Empty, SimpleQueue
from typing import Protocol, Self

from bridge.bus.contract import BusError, Message
from bridge.bus.handlers import Guarded, HandlerError
from bridge.bus.inbox import Inbox, Reading, newest_last
from bridge.bus.keyexpr import check_key, check_pattern, check_patterns, matches


class MemoryBroker:
    """What the buses meet at; it stands for the router. Safe to use from any thread."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.running = True
        self.publishers: list[_Publisher] = []
        self.subscriptions: list[_Subscription] = []
        self.answerers: list[_Answerer] = []
        self.tokens: list[_Token] = []
        self.watchers: list[_Watcher] = []

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
            watcher.update(self.tokens)
        for subscription in self.subscriptions:
            for publisher in self.publishers:
                subscription.repair(publisher)


class MemoryBus:
    """A session at a broker. See contract.Bus."""

    def __init__(self, broker: MemoryBroker) -> None:
        self._broker = broker
        self._attached = True
        self._closed = False

    def publisher(self, key: str, *, cache: int = 0) -> "_Publisher":
        """See contract.Bus."""
        return _Publisher(self, self._open(), check_key(key), cache)

    def subscribe(
        self,
        patterns: str | Sequence[str],
        *,
        history: bool = False,
        capacity: int = 65536,
        all_past: bool = True,
        most_past: int | None = None,
    ) -> "_Subscription":
        """See contract.Bus."""
        inbox = Inbox(capacity, all_past=all_past)
        return _Subscription(self, self._open(), check_patterns(patterns), inbox, most_past, history=history)

    def answer(self, pattern: str, handler: Callable[[str, bytes], bytes]) -> "_Answerer":
        """See contract.Bus."""
        return _Answerer(self, self._open(), check_pattern(pattern), handler)

    def ask(self, key: str, payload: bytes, timeout_s: float = 2.0) -> bytes:
        """See contract.Bus."""
        broker = self._open()
        check_key(key)
        with broker.lock:
            able = [a for a in broker.answerers if self.reaches(a.bus) and matches(a.pattern, key)]
            done = SimpleQueue[_Question]()
            for answerer in able:
                answerer.take(_Question(key, bytes(payload), done))
        if not able:
            raise BusError(f"nobody answers {key!r}; is the service that should answer running?")
        deadline, errors = time.monotonic() + timeout_s, list[str]()
        while len(errors) < len(able):
            try:
                question = done.get(timeout=max(0.0, deadline - time.monotonic()))
            except Empty:
                raise BusError(f"no answer to {key!r} within {timeout_s:g} s") from None
            if question.reply:
                return question.reply
            errors.append(question.error)
        raise BusError(f"{key!r} was answered with an error: {'; '.join(errors)}")

    def declare_alive(self, key: str) -> "_Token":
        """See contract.Bus."""
        return _Token(self, self._open(), check_key(key))

    def watch_alive(self, pattern: str, on_change: Callable[[str, bool], None]) -> "_Watcher":
        """See contract.Bus."""
        return _Watcher(self, self._open(), check_pattern(pattern), on_change)

    @property
    def connected(self) -> bool:
        """See contract.Bus."""
        return self._attached and self._broker.running and not self._closed

    def detach(self) -> None:
        """Begin an outage of this bus alone."""
        with self._broker.lock:
            self._attached = False
            self._broker.settle()

    def attach(self) -> None:
        """End it."""
        with self._broker.lock:
            self._attached = True
            self._broker.settle()

    def reaches(self, other: "MemoryBus") -> bool:
        """Whether what happens in this bus is noticed in the other one; a bus always reaches itself."""
        return self is other or (self.connected and other.connected)

    def close(self) -> None:
        """See contract.Bus."""
        broker = self._broker
        with broker.lock:
            if self._closed:
                return
            kinds: tuple[Sequence[_Declared], ...] = (
                broker.publishers,
                broker.subscriptions,
                broker.answerers,
                broker.watchers,
                broker.tokens,
            )
            for declared in [one for kind in kinds for one in kind]:
                if declared.bus is self:
                    declared.close()
            self._closed = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _open(self) -> MemoryBroker:
        if self._closed:
            raise BusError("this bus is closed; open a new one")
        return self._broker


class _Declared(Protocol):
    bus: MemoryBus

    def close(self) -> None: ...


class _Publisher:
    def __init__(self, bus: MemoryBus, broker: MemoryBroker, key: str, cache: int) -> None:
        self.bus, self.key, self._broker = bus, key, broker
        self.cached: deque[tuple[int, Message]] = deque(maxlen=cache)
        self._sequence = 0
        self._closed = False
        with broker.lock:
            broker.publishers.append(self)

    def put(self, payload: bytes) -> None:
        message = Message(self.key, bytes(payload))
        with self._broker.lock:
            if self._closed:
                raise BusError(f"the publisher of {self.key!r} is closed")
            self._sequence += 1
            self.cached.append((self._sequence, message))
            for subscription in self._broker.subscriptions:
                subscription.offer(self, self._sequence, message)

    @property
    def wanted(self) -> bool:
        with self._broker.lock:
            return self.cached.maxlen != 0 or any(s.hears(self) for s in self._broker.subscriptions)

    def close(self) -> None:
        with self._broker.lock:
            if not self._closed:
                self._closed = True
                self._broker.publishers.remove(self)


class _Subscription(Reading):
    def __init__(
        self,
        bus: MemoryBus,
        broker: MemoryBroker,
        patterns: tuple[str, ...],
        inbox: Inbox,
        most_past: int | None,
        *,
        history: bool,
    ) -> None:
        self.bus, self._broker, self._patterns, self._inbox, self._history = bus, broker, patterns, inbox, history
        self._last: dict[_Publisher, int] = {}
        with broker.lock:
            broker.subscriptions.append(self)
            pasts = [past for publisher in broker.publishers if (past := self._news(publisher))]
            self._inbox.put(newest_last([past[-most_past:] if most_past else past for past in pasts]), past=True)

    def offer(self, publisher: _Publisher, sequence: int, message: Message) -> None:
        if self.hears(publisher):
            self._last[publisher] = sequence
            self._inbox.put([message])

    def hears(self, publisher: _Publisher) -> bool:
        return publisher.bus.reaches(self.bus) and any(matches(pattern, publisher.key) for pattern in self._patterns)

    def repair(self, publisher: _Publisher) -> None:
        past = publisher not in self._last
        self._inbox.put(self._news(publisher), past=past)

    def _news(self, publisher: _Publisher) -> list[Message]:
        """What it has kept, and was not heard here."""
        if not (self._history and self.hears(publisher)):
            return []
        last = self._last.get(publisher)
        new = [(n, message) for n, message in publisher.cached if n > (last or 0)]
        if new:
            if last is not None:
                self._inbox.add_missed(new[0][0] - last - 1, publisher.key)
            self._last[publisher] = new[-1][0]
        return [message for _, message in new]

    def close(self) -> None:
        with self._broker.lock:
            if self in self._broker.subscriptions:
                self._broker.subscriptions.remove(self)
        self._inbox.close()


class _Question:
    def __init__(self, key: str, payload: bytes, done: "SimpleQueue[_Question]") -> None:
        self.key, self.payload, self.done = key, payload, done
        self.reply: bytes | None = None
        self.error = "an empty answer"


class _Answerer:
    def __init__(
        self, bus: MemoryBus, broker: MemoryBroker, pattern: str, handler: Callable[[str, bytes], bytes]
    ) -> None:
        self.bus, self.pattern, self._broker = bus, pattern, broker
        self._handler = Guarded(handler, f"queries on {pattern}")
        self._questions: SimpleQueue[_Question | None] = SimpleQueue()
        with broker.lock:
            broker.answerers.append(self)
        threading.Thread(target=self._run, name=f"answer {pattern}", daemon=True).start()

    def take(self, question: _Question) -> None:
        self._questions.put(question)

    def _run(self) -> None:
        while question := self._questions.get():
            try:
                question.reply = self._handler(question.key, question.payload)
            except HandlerError as error:
                question.error = str(error)
            question.done.put(question)

    def close(self) -> None:
        with self._broker.lock:
            if self in self._broker.answerers:
                self._broker.answerers.remove(self)
                self._questions.put(None)


class _Token:
    def __init__(self, bus: MemoryBus, broker: MemoryBroker, key: str) -> None:
        self.bus, self.key, self._broker = bus, key, broker
        with broker.lock:
            broker.tokens.append(self)
            broker.settle()

    def close(self) -> None:
        with self._broker.lock:
            if self in self._broker.tokens:
                self._broker.tokens.remove(self)
                self._broker.settle()


class _Watcher:
    def __init__(
        self, bus: MemoryBus, broker: MemoryBroker, pattern: str, on_change: Callable[[str, bool], None]
    ) -> None:
        self.bus, self._broker, self._pattern = bus, broker, pattern
        self._on_change = Guarded(on_change, f"liveliness of {pattern}")
        self._alive: set[str] = set()
        self._changes: SimpleQueue[tuple[str, bool] | None] = SimpleQueue()
        with broker.lock:
            broker.watchers.append(self)
            self.update(broker.tokens)
        threading.Thread(target=self._run, name=f"watch {pattern}", daemon=True).start()

    def update(self, tokens: list[_Token]) -> None:
        alive = {t.key for t in tokens if t.bus.reaches(self.bus) and matches(self._pattern, t.key)}
        for key in sorted(self._alive - alive):
            self._changes.put((key, False))
        for key in sorted(alive - self._alive):
            self._changes.put((key, True))
        self._alive = alive

    def _run(self) -> None:
        while change := self._changes.get():
            try:
                self._on_change(*change)
            except HandlerError:
                continue  # already logged; the next change may well be handled

    def close(self) -> None:
        with self._broker.lock:
            if self in self._broker.watchers:
                self._broker.watchers.remove(self)
                self._changes.put(None)
