"""The only file that imports zenoh: a session that keeps contract.Bus.

Everything arrives through zenoh's channels and is handed on by daemon threads of ours. zenoh's callbacks would each
bring a thread that keeps a failed program from exiting, or would need the interpreter's lock on zenoh's receive path.
"""

import atexit
import contextlib
import json
import logging
import re
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Protocol, Self, TypeVar

import zenoh
from zenoh import ext, handlers

from bridge.bus import zenoh_settings
from bridge.bus.contract import BusError, Message
from bridge.bus.handlers import Guarded, HandlerError
from bridge.bus.inbox import Inbox
from bridge.bus.keyexpr import check_key, check_pattern, matches
from bridge.bus.routers import Routers
from bridge.bus.sequences import Sequences

_T_co = TypeVar("_T_co", covariant=True)
_T = TypeVar("_T")
_log = logging.getLogger(__name__)

_CHANNEL = 65536  # between zenoh and our thread, which always drains; a full one would stop the session's receiving
_BATCH = 512
_EVERYBODY = ""
_TURN_S = 0.002
_HEARTBEAT_S = 0.25  # sent only when something was published since the last one
_JOIN_S = 1.0
_MAX_KNOWN = 8192
_RETRY_S = 0.1
_PAST_S = 2.0
# After a reconnection; zenoh knows who listens some 25 ms later here, over slow lines and to a router that is back later, later.
_REMIND_S = (0.5, 2.0)
_PARTS = (
    *("mode", "connect", "listen", "scouting", "adminspace", "timestamping", "qos", "transport", "low_pass_filter"),
    "access_control",
)


def open_session(settings: zenoh_settings.Settings, complaint: str, timeout_s: float = 0.0) -> zenoh.Session:
    """Open a session, trying for timeout_s, or raise BusError beginning with complaint."""
    with _as_bus_error(complaint):
        config = zenoh.Config.from_json5(json.dumps(settings))
        deadline = time.monotonic() + timeout_s
        while True:
            try:
                return zenoh.open(config)
            except zenoh.ZError:
                if time.monotonic() >= deadline:
                    raise
            time.sleep(_RETRY_S)


def read_settings(path: str) -> zenoh_settings.Settings:
    """A file of zenoh's own, JSON5, as zenoh understands it: with every default; BusError says what is wrong with it."""
    with _as_bus_error(f"{path}: zenoh cannot read it"):
        config = zenoh.Config.from_file(path)
        return {part: json.loads(config.get_json(part)) for part in _PARTS}


def close_session(session: zenoh.Session) -> None:
    """Close a session, however broken it is."""
    with _as_bus_error("could not close the session"):
        session.close()  # type: ignore[no-untyped-call]


class _Channel(Protocol[_T_co]):
    def recv(self) -> _T_co: ...
    def try_recv(self) -> _T_co | None: ...


class _Undeclared(Protocol):
    def undeclare(self) -> object: ...


class ZenohBus:
    """A client of one or more routers; see contract.Bus. Reconnects by itself for as long as it lives.

    endpoints: where routers listen, for example `tcp/127.0.0.1:7447`; the first that answers is used, the others are
    where to go when it is lost; `Routers` says who we are, too. Raises BusError when none answers within open_timeout_s,
    and at once where our certificate is of no use.
    """

    def __init__(self, endpoints: Sequence[str], *, open_timeout_s: float = 3.0) -> None:
        routers = Routers.of(endpoints)
        self._where = ", ".join(endpoints)
        if not endpoints:
            raise BusError("no router to connect to; name one, for example tcp/127.0.0.1:7447")
        if wrong := routers.faults():
            raise BusError("; ".join(wrong))
        complaint = f"no router answered at {self._where} within {open_timeout_s:g} s; start one with `truerate router`"
        if routers.identity is not None:
            # zenoh does not say why; the router's own log does.
            complaint += ", or see its log: it may refuse our certificate, or its own may be for another name than this"
        self._session = open_session(zenoh_settings.client(endpoints, routers.identity), complaint, open_timeout_s)
        self._known: set[str] = set()
        self._plain: set[str] = set()
        self.declared: set[_Declared] = set()  # zenoh takes back what nobody holds
        self._threads: set[threading.Thread] = set()
        self._cached = 0
        self._closed = False
        self._over = threading.Event()
        links = self._session.info.declare_transport_events_listener(handlers.FifoChannel(256))
        self.run(lambda: _each(links.handler, self._remind), "remind")
        atexit.register(self.close)

    def publisher(self, key: str, *, cache: int = 0) -> "_Publisher":
        """See contract.Bus."""
        # BLOCK, because DROP silently lost two thirds at saturation and bursts of a few thousand. A frozen reader is
        # cut off by the router after CUT_OFF_S, which bounds how long a put can wait for it.
        block = zenoh.CongestionControl.BLOCK
        with self._doing(f"publish on {check_key(key)}"):
            if cache <= 0:
                plain = self._session.declare_publisher(key, congestion_control=block)
                return _Publisher(self, plain, key, plain)
            self._cached += cache
            publisher = ext.declare_advanced_publisher(
                self._session,
                self._session.declare_keyexpr(key),  # a third less work in every put
                congestion_control=block,
                cache=ext.CacheConfig(cache),
                sample_miss_detection=ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=_HEARTBEAT_S),
                publisher_detection=True,
            )
            return _Publisher(self, publisher, key)

    def subscribe(self, pattern: str, *, history: bool = False, capacity: int = 65536) -> "_Subscription":
        """See contract.Bus. Ask for history only where publishers have a cache.

        Behind a router that stamps times (zenohd unless told otherwise) uncached messages may be dropped as old.
        What a publisher with a still empty cache sends within some 5 ms of this call may not be seen.
        """
        inbox = Inbox(capacity)
        # Declaring delivers the history of this session's own publishers at once, before anybody drains the channel.
        channel: handlers.FifoChannel[zenoh.Sample] = handlers.FifoChannel(_CHANNEL + self._cached)
        with self._doing(f"subscribe to {check_pattern(pattern)}"):
            if not history:
                self._plain.add(pattern)
                plain = self._session.declare_subscriber(pattern, channel)
                return _Subscription(self, plain, plain.handler, inbox, pattern)
            heartbeats = self._session.declare_subscriber(f"{pattern}/@adv/pub/**", handlers.FifoChannel(_CHANNEL))
            return _Repaired(self, self._session.declare_subscriber(pattern, channel), heartbeats, inbox, pattern)

    def answer(self, pattern: str, handler: Callable[[str, bytes], bytes]) -> "_Declared":
        """See contract.Bus."""
        guarded = Guarded(handler, f"queries on {pattern}")
        with self._doing(f"answer {check_pattern(pattern)}"):
            # A ring: more questions than this unanswered, and the oldest asker is told that nobody answered.
            queryable = self._session.declare_queryable(pattern, handlers.RingChannel(256), complete=True)
        self.run(lambda: _each(queryable.handler, lambda query: _reply(query, guarded)), f"answer {pattern}")
        return _Declared(self, queryable)

    def ask(self, key: str, payload: bytes, timeout_s: float = 2.0) -> bytes:
        """See contract.Bus."""
        with self._doing(f"ask {check_key(key)}"):
            replies = self._session.get(
                key,
                handlers.FifoChannel(64),
                target=zenoh.QueryTarget.ALL,
                payload=payload,
                timeout=timeout_s,
                consolidation=zenoh.ConsolidationMode.NONE,
            )
            errors = []
            for reply in replies:
                if reply.ok is not None and len(reply.ok.payload):
                    return reply.ok.payload.to_bytes()
                errors.append(reply.err.payload.to_bytes().decode(errors="replace") if reply.err else "an empty answer")
        if not errors:
            raise BusError(f"nobody answers {key!r}; is the service that should answer running?")
        raise BusError(f"{key!r} was answered with an error: {'; '.join(errors)}")

    def declare_alive(self, key: str) -> "_Declared":
        """See contract.Bus."""
        with self._doing(f"declare {check_key(key)} alive"):
            return _Declared(self, self._session.liveliness().declare_token(key))

    def watch_alive(self, pattern: str, on_change: Callable[[str, bool], None]) -> "_Declared":
        """See contract.Bus. A lost router takes all tokens with it: ask `connected` before calling one dead.

        zenoh 1.10.2 may go on reporting a token that dies in the very millisecond in which a watcher joins (3 in 1800
        under load, timed to hit) until the session reconnects: alive is a hint, data that arrives is the proof.
        """
        guarded = Guarded(on_change, f"liveliness of {pattern}")
        with self._doing(f"watch {check_pattern(pattern)}"):
            watcher = self._session.liveliness().declare_subscriber(
                pattern, handlers.FifoChannel(_CHANNEL), history=True
            )
        alive: set[str] = set()

        def tell(sample: zenoh.Sample) -> None:
            key, now = str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT
            if now != (key in alive):
                alive.symmetric_difference_update((key,))
                guarded(key, now)

        self.run(lambda: _each(watcher.handler, tell), f"watch {pattern}")
        return _Declared(self, watcher)

    @property
    def connected(self) -> bool:
        """See contract.Bus."""
        return not self._closed and bool(self._session.info.routers_zid())

    def learn(self, keys: set[str]) -> None:
        """Make zenoh remember keys; else it searches all caches of all publishers anew for every message it receives.

        Measured with 1000 publishers: 41 µs a message before, 3.5 µs after. A message that comes at this very moment
        may be lost, so only for keys whose every reader here repairs losses.
        """
        for key in keys - self._known:
            if len(self._known) >= _MAX_KNOWN:
                return
            self._known.add(key)
            with contextlib.suppress(BusError):  # a foreign key that we would not take is not worth remembering
                if not any(matches(pattern, check_key(key)) for pattern in self._plain):
                    self._session.declare_keyexpr(key)

    def past(self, selector: str, what: str = "") -> handlers.Handler[zenoh.Reply]:
        """What caches of publishers hold, as it comes; asked for at once. Closed when all have answered, or the session is."""
        return self._session.get(
            f"{selector}?{what}",
            handlers.FifoChannel(_CHANNEL + self._cached),  # our own caches answer before this returns
            consolidation=zenoh.ConsolidationMode.NONE,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
            timeout=_PAST_S,
        )

    def _remind(self, event: zenoh.TransportEvent) -> None:
        """After a router is back, say what was last: what is put in the first moments reaches nobody, nor does the heartbeat."""
        if event.kind != zenoh.SampleKind.PUT:
            return
        started = time.monotonic()
        for after_s in _REMIND_S:
            if self._over.wait(started + after_s - time.monotonic()):
                return
            for one in list(self.declared):
                if isinstance(one, _Publisher):
                    one.remind(self._session)
                elif isinstance(one, _Repaired):
                    one.remind()

    def run(self, work: Callable[[], None], name: str) -> None:
        """Run work in a thread that close() waits for; work must end when its channel does."""

        def body() -> None:
            try:
                work()
            finally:
                self._threads.discard(thread)

        thread = threading.Thread(target=body, name=name, daemon=True)
        self._threads.add(thread)
        thread.start()

    def close(self) -> None:
        """See contract.Bus."""
        if self._closed:
            return
        self._closed = True
        self._over.set()
        atexit.unregister(self.close)
        close_session(self._session)
        for thread in list(self._threads):
            if thread is not threading.current_thread():
                thread.join(_JOIN_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextlib.contextmanager
    def _doing(self, what: str) -> Iterator[None]:
        with _as_bus_error(f"could not {what} at {self._where}"):
            yield


class _Declared:
    def __init__(self, bus: ZenohBus, declared: _Undeclared) -> None:
        self._bus, self._declared = bus, declared
        self._lock = threading.Lock()
        self._closed = False
        bus.declared.add(self)

    def close(self) -> None:
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._bus.declared.discard(self)
            try:
                self._declared.undeclare()
            except zenoh.ZError:
                _log.debug("already gone with its session")


class _Publisher(_Declared):
    def __init__(
        self,
        bus: ZenohBus,
        publisher: zenoh.Publisher | ext.AdvancedPublisher,
        key: str,
        plain: zenoh.Publisher | None = None,
    ) -> None:
        super().__init__(bus, publisher)
        self._publisher, self._key, self._plain = publisher, key, plain
        self._sent = 0

    def put(self, payload: bytes) -> None:
        with self._lock:  # messages leave in the order they are numbered
            if self._closed:
                raise BusError(f"the publisher of {self._key!r} is closed")
            try:
                self._publisher.put(payload)
                self._sent += 1
            except BaseException as error:
                if not _is_zenohs(error):
                    raise
                raise BusError(f"could not publish on {self._key!r} ({_said(error)})") from error

    def remind(self, session: zenoh.Session) -> None:
        """Tell readers the number of the last message, as zenoh's own heartbeat does: who lacks it asks for it."""
        if self._plain is not None or not self._sent:
            return
        whose = self._publisher.id
        number = ext.z_serialize(ext.UInt32((self._sent - 1) % (1 << 32)))
        with contextlib.suppress(zenoh.ZError):  # closed meanwhile
            session.put(f"{self._key}/@adv/pub/{whose.zid}/{whose.eid}/_", number)

    @property
    def wanted(self) -> bool:
        if self._plain is None:
            return True
        try:
            return bool(self._plain.matching_status.matching)  # type: ignore[attr-defined] # its stub has it wrong
        except zenoh.ZError:
            return False  # it is closed


class _Subscription(_Declared):
    """Hands on what comes, from a thread of its own."""

    def __init__(
        self,
        bus: ZenohBus,
        subscriber: _Undeclared,
        samples: _Channel[zenoh.Sample],
        inbox: Inbox,
        pattern: str,
    ) -> None:
        super().__init__(bus, subscriber)
        self._samples, self._inbox = samples, inbox
        bus.run(self._pump, f"receive {pattern}")

    def _pump(self) -> None:
        try:
            self._begin()
            while True:
                batch = [self._samples.recv()]
                while len(batch) < _BATCH and (sample := self._samples.try_recv()) is not None:
                    batch.append(sample)
                self._take([sample for sample in batch if sample.kind == zenoh.SampleKind.PUT])
        except zenoh.ZError:
            _log.debug("subscription closed")
        finally:
            self._end()

    def _begin(self) -> None:
        """Before anything is taken."""

    def _end(self) -> None:
        """Nothing will ever come again."""
        self._inbox.close()

    def _take(self, samples: Sequence[zenoh.Sample]) -> None:
        self._inbox.put(map(_message, samples))

    def receive(self, timeout_s: float) -> Message | None:
        return self._inbox.receive(timeout_s)

    def drain(self, limit: int, timeout_s: float) -> list[Message]:
        return self._inbox.drain(limit, timeout_s)

    @property
    def missed(self) -> int:
        return self._inbox.missed

    @property
    def missed_by_key(self) -> dict[str, int]:
        return self._inbox.missed_by_key

    @property
    def overflowed(self) -> int:
        return self._inbox.overflowed

    @property
    def waited_s(self) -> float:
        return self._inbox.waited_s

    @property
    def closed(self) -> bool:
        return self._inbox.closed

    def close(self) -> None:
        self._end()
        super().close()


class _Repaired(_Subscription):
    """With what publishers' caches held, and hold of what was lost; see Sequences."""

    def __init__(
        self,
        bus: ZenohBus,
        subscriber: zenoh.Subscriber[handlers.Handler[zenoh.Sample]],
        heartbeats: zenoh.Subscriber[handlers.Handler[zenoh.Sample]],
        inbox: Inbox,
        pattern: str,
    ) -> None:
        self._pattern, self._heartbeats = pattern, heartbeats
        self._sequences: Sequences[Message] = Sequences()
        self._order = threading.Lock()  # of whatever is handed on
        self._news, self._away = threading.Event(), threading.Event()  # there may be a gap; and perhaps in everything
        self._first = bus.past(f"{pattern}/@adv/**")
        super().__init__(bus, subscriber, subscriber.handler, inbox, pattern)
        bus.run(lambda: _each(heartbeats.handler, self._heard), f"heartbeats of {pattern}")
        bus.run(self._go_on_repairing, f"repair {pattern}")

    def _begin(self) -> None:
        first: list[zenoh.Sample] = []
        while not _drained(self._first, first):
            time.sleep(_TURN_S)
        for source, found in _by_source(first).items():
            key = next(iter(found.values())).key
            self._hand_on(partial(self._sequences.history, source, key, found))

    def _take(self, samples: Sequence[zenoh.Sample]) -> None:
        now_s, ready, cached = time.monotonic(), list[Message](), set[str]()
        with self._order:
            for sample in samples:
                message, info = _message(sample), sample.source_info
                if info is None:  # of a publisher without a cache
                    ready.append(message)
                else:
                    cached.add(message.key)
                    ready += self._sequences.take(_source(info), message.key, info.source_sn, message, now_s)
            self._inbox.put(ready)
            lacking = self._sequences.next_due_s() is not None
        if lacking:
            self._news.set()
        self._bus.learn(cached)

    def _heard(self, sample: zenoh.Sample) -> None:
        """One of zenoh's heartbeats: KEY/@adv/pub/SESSION/PUBLISHER/_, and the number of its last message."""
        key, _, rest = str(sample.key_expr).rpartition("/@adv/pub/")
        source = "/".join(rest.split("/")[:2])
        try:
            number = int(ext.z_deserialize(ext.UInt32, sample.payload))
        except ext.ZDeserializeError:
            _log.debug("no heartbeat: %s", sample.key_expr)
            return
        with self._order:
            self._sequences.heard(source, key, number, time.monotonic())
        self._news.set()

    def remind(self) -> None:
        """We were away, and did not hear what we missed: ask everybody for the last message."""
        self._away.set()
        self._news.set()

    def _end(self) -> None:
        super()._end()
        self._news.set()

    def _go_on_repairing(self) -> None:
        try:
            self._repair()
        except zenoh.ZError as error:
            if not self._inbox.closed:
                _log.error("what is lost of %s is not fetched again any more (%s)", self._pattern, _said(error))

    def _repair(self) -> None:
        """Ask about gaps, all that are due at once; who hangs keeps only its own waiting."""
        asked: dict[str, tuple[_Channel[zenoh.Reply], list[zenoh.Sample]]] = {}
        while not self._inbox.closed:
            if self._away.is_set() and _EVERYBODY not in asked:
                self._away.clear()
                asked[_EVERYBODY] = (self._bus.past(f"{self._pattern}/@adv/**", "_max=1"), [])
            with self._order:
                gaps, due_s = self._sequences.due(time.monotonic()), self._sequences.next_due_s()
            for gap in gaps:
                asked[gap.source] = (self._bus.past(f"{gap.key}/@adv/pub/{gap.source}/**", f"_sn={gap.start}.."), [])
            for source in [source for source, answer in asked.items() if _drained(*answer)]:
                self._answered(source, asked.pop(source)[1])
            wait_s = _TURN_S if asked else None if due_s is None else max(due_s - time.monotonic(), 0.0)
            self._news.wait(wait_s)
            self._news.clear()

    def _answered(self, source: str, found: list[zenoh.Sample]) -> None:
        now_s = time.monotonic()
        by_source = _by_source(found)
        if source != _EVERYBODY:
            self._hand_on(partial(self._sequences.answered, source, by_source.get(source, {}), now_s))
            return
        with self._order:
            for each, last in by_source.items():
                number, message = max(last.items())
                self._sequences.heard(each, message.key, number, now_s)

    def _hand_on(self, ready: Callable[[], Sequence[Message]]) -> None:
        with self._order:
            self._inbox.put(ready())
            for key, count in self._sequences.missed.items():
                self._inbox.add_missed(count, key)
            self._sequences.missed.clear()

    def close(self) -> None:
        super().close()
        with contextlib.suppress(zenoh.ZError):
            self._heartbeats.undeclare()  # type: ignore[no-untyped-call]


def _message(sample: zenoh.Sample) -> Message:
    return Message(str(sample.key_expr), sample.payload.to_bytes())


def _by_source(samples: Iterable[zenoh.Sample]) -> dict[str, dict[int, Message]]:
    """Of each publisher its messages by number."""
    found: dict[str, dict[int, Message]] = {}
    for sample in samples:
        if (info := sample.source_info) is not None:
            found.setdefault(_source(info), {})[info.source_sn] = _message(sample)
    return found


def _drained(replies: _Channel[zenoh.Reply], into: list[zenoh.Sample]) -> bool:
    """Take what has been answered; whether that was all."""
    try:
        while (reply := replies.try_recv()) is not None:
            if reply.ok is not None:
                into.append(reply.ok)
    except zenoh.ZError:
        return True
    return False


def _source(info: zenoh.SourceInfo) -> str:
    """A publisher; its id has no hash."""
    return f"{info.source_id.zid}/{info.source_id.eid}"


def _each(channel: _Channel[_T], handle: Callable[[_T], None]) -> None:
    """Handle what comes until the channel is closed."""
    while True:
        try:
            item = channel.recv()
        except zenoh.ZError:
            return
        try:
            handle(item)
        except HandlerError:
            continue  # already logged; the next one may well be handled


def _reply(query: zenoh.Query, handler: Guarded[[str, bytes], bytes]) -> None:
    """Answer one query; leaving the block tells the asker that no more is to come."""
    with query:
        key = str(query.key_expr)
        try:
            try:
                check_key(key)
                answer = handler(key, query.payload.to_bytes() if query.payload is not None else b"")
            except (BusError, HandlerError) as error:
                query.reply_err(str(error).encode())
            else:
                query.reply(query.key_expr, answer)
        except zenoh.ZError as error:
            _log.warning("an answer to %s could not be sent: %s", key, error)


@contextlib.contextmanager
def _as_bus_error(complaint: str) -> Iterator[None]:
    try:
        yield
    except BaseException as error:
        if not _is_zenohs(error):
            raise
        raise BusError(f"{complaint} ({_said(error)})") from error


def _said(error: BaseException) -> str:
    """What zenoh said, without the lines of its source."""
    return re.sub(r"\s*\bat /\S+\.rs:\d+\.?", "", str(error)).strip()


def _is_zenohs(error: BaseException) -> bool:
    """Whether zenoh failed; a panic of its Rust side is not even an Exception, and has no name to import."""
    return isinstance(error, zenoh.ZError) or type(error).__name__ == "PanicException"
