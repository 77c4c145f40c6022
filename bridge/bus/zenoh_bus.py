"""A session of zenoh that keeps contract.Bus."""

import atexit
import contextlib
import logging
import re
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Self

import zenoh
from zenoh import ext, handlers

from bridge.bus import zenoh_settings
from bridge.bus.announced import Announced
from bridge.bus.contract import BusError
from bridge.bus.handlers import Guarded, HandlerError
from bridge.bus.inbox import Inbox
from bridge.bus.keyexpr import check_key, check_pattern, check_patterns, matches
from bridge.bus.knock import knock
from bridge.bus.routers import Routers
from bridge.bus.zenoh_session import (
    Declared,
    Joined,
    Together,
    as_bus_error,
    close_session,
    each,
    is_zenohs,
    open_session,
    said,
)
from bridge.bus.zenoh_subscription import PAST_S, Repaired, Subscription

_log = logging.getLogger(__name__)

_CHANNEL = 65536  # between zenoh and our thread, which always drains; a full one would stop the session's receiving
# How soon after a message the number of the last is told, if it was not. Who keeps so many messages says the next one soon, which
# tells as much: zenoh's heartbeats, four a second while anything is published, are for the others.
_HEARTBEAT_S, _STREAM = 0.25, 64
_JOIN_S = 1.0
_MAX_KNOWN = 8192
# After a reconnection; zenoh knows who listens some 25 ms later here, over slow lines and to a router that is back later, later.
_REMIND_S = (0.5, 2.0)
# So often, and for so long after its last message, a publisher says which that was: lines between routers may have been cut.
_REPEAT_S, _REPEATED_S = 2.0, 40.0
# How often it is announced anew that we keep streams; of other things little is kept, and that rarely fetched again.
_ANNOUNCE_S, _ANNOUNCED = 3.0, 16
_PORT = re.compile(r"\A(?:tcp|tls)/.*:(\d{1,5})(?:[?#].*)?\Z")


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
        try:
            self._session = open_session(zenoh_settings.client(endpoints, routers.identity), "", open_timeout_s)
        except BusError as error:
            raise BusError(
                f"no router answered at {self._where} within {open_timeout_s:g} s{_why(routers)}{error}"
            ) from error.__cause__
        self._known: set[str] = set()
        self._plain: set[str] = set()
        self.declared: set[Declared] = set()  # zenoh takes back what nobody holds
        self._threads: set[threading.Thread] = set()
        self._cached = 0
        #: keys below which our caches of streams answer
        self._streams: set[str] = set()
        self._closed = False
        self._over = threading.Event()
        links = self._session.info.declare_transport_events_listener(handlers.FifoChannel(256))
        self.run(lambda: each(links.handler, self._remind), "remind")
        self.run(self._repeat, "repeat")
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
            if cache >= _ANNOUNCED:
                self._streams.add(f"{key.rpartition('/')[0]}/*/@adv/pub/{self._session.zid()}/*")
            publisher = ext.declare_advanced_publisher(
                self._session,
                self._session.declare_keyexpr(key),  # a third less work in every put
                congestion_control=block,
                cache=ext.CacheConfig(cache),
                sample_miss_detection=ext.MissDetectionConfig(
                    heartbeat=None, sporadic_heartbeat=None if cache >= _STREAM else _HEARTBEAT_S
                ),
                # Nobody listens for it (zenoh does not understand it below `@v1`), and a router has as much to do with it, when a
                # session ends, as with a cache: all of it while everybody waits.
                publisher_detection=False,
            )
            return _Publisher(self, publisher, key, stream=cache >= _STREAM)

    def subscribe(
        self,
        patterns: str | Sequence[str],
        *,
        history: bool = False,
        capacity: int = 65536,
        all_past: bool = True,
        most_past: int | None = None,
    ) -> "Subscription":
        """See contract.Bus. Ask for history only where publishers have a cache.

        What a publisher with a still empty cache sends within some 5 ms of this call may not be seen.
        """
        inbox = Inbox(capacity, all_past=all_past)
        patterns = check_patterns(patterns)
        with self._doing(f"subscribe to {', '.join(patterns)}"):
            if not history:
                self._plain.update(patterns)
                return Subscription(self, *self._heard(patterns), inbox, patterns)
            heartbeats = self._heard([f"{pattern}/@adv/pub/**" for pattern in patterns])
            return Repaired(self, *self._heard(patterns), heartbeats, inbox, patterns, most_past)

    def _heard(self, patterns: Sequence[str]) -> tuple[Together, Joined[zenoh.Sample]]:
        found = list[zenoh.Subscriber[handlers.Handler[zenoh.Sample]]]()
        for one in patterns:
            channel: handlers.FifoChannel[zenoh.Sample] = handlers.FifoChannel(_CHANNEL)
            found.append(self._session.declare_subscriber(one, channel))
        return Together(found), Joined([one.handler for one in found])

    def answer(self, pattern: str, handler: Callable[[str, bytes], bytes]) -> "Declared":
        """See contract.Bus."""
        guarded = Guarded(handler, f"queries on {pattern}")
        with self._doing(f"answer {check_pattern(pattern)}"):
            # A ring: more questions than this unanswered, and the oldest asker is told that nobody answered.
            queryable = self._session.declare_queryable(pattern, handlers.RingChannel(256), complete=True)
        self.run(lambda: each(queryable.handler, lambda query: _reply(query, guarded)), f"answer {pattern}")
        return Declared(self, queryable)

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

    def declare_alive(self, key: str) -> "Declared":
        """See contract.Bus."""
        with self._doing(f"declare {check_key(key)} alive"):
            return Declared(self, self._session.liveliness().declare_token(key))

    def watch_alive(self, pattern: str, on_change: Callable[[str, bool], None]) -> "Declared":
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

        self.run(lambda: each(watcher.handler, tell), f"watch {pattern}")
        return Declared(self, watcher)

    @property
    def connected(self) -> bool:
        """See contract.Bus."""
        return not self._closed and bool(self._session.info.routers_zid())

    @property
    def ports(self) -> frozenset[int]:
        """See contract.Bus."""
        ends = (_PORT.search(str(link.src)) for link in self._session.info.links())
        return frozenset(int(end[1]) for end in ends if end)

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
            timeout=PAST_S,
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
                elif isinstance(one, Repaired):
                    one.remind()

    def _repeat(self) -> None:
        """Say again what was last of publishers that say nothing more: nothing that follows tells who did not hear it."""
        announced, announce_s = Announced(self, self._session), time.monotonic() + _ANNOUNCE_S
        while not self._over.wait(_HEARTBEAT_S):
            now_s = time.monotonic()
            if now_s >= announce_s:
                announce_s = now_s + _ANNOUNCE_S
                with contextlib.suppress(BusError), as_bus_error("closed meanwhile"):
                    announced.anew(sorted(self._streams))
            for one in list(self.declared):
                if isinstance(one, _Publisher) and one.due(now_s):
                    one.remind(self._session)

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
        with as_bus_error(f"could not {what} at {self._where}"):
            yield


def _why(routers: Routers) -> str:
    """What a person can do about it, where nobody answers."""
    silent = {endpoint: words for endpoint in routers if (words := knock(endpoint))}
    said = [f"{endpoint}: {words}" if len(routers) > 1 else words for endpoint, words in silent.items()]
    if len(silent) == len(routers):
        return f": {'; '.join(said)}; start one with `truerate router`"
    there = ", ".join(endpoint for endpoint in routers if endpoint not in silent)
    if routers.identity is None:
        said.append(
            f"what is at {there} may ask for a certificate (tls/...), or be no router: start one with `truerate router`"
        )
    else:
        said.append(
            f"if there is one at {there}, see its log: it may not let in our certificate (`truerate pki router` writes its files"
            " anew), or its own may be for another name than this"
        )
    return f": {'; '.join(said)}"


class _Publisher(Declared):
    def __init__(
        self,
        bus: ZenohBus,
        publisher: zenoh.Publisher | ext.AdvancedPublisher,
        key: str,
        plain: zenoh.Publisher | None = None,
        *,
        stream: bool = False,
    ) -> None:
        self._publisher, self._key, self._plain, self._stream = publisher, key, plain, stream
        #: asked once: while it is taken back on another thread zenoh has no answer
        self._whose = publisher.id
        self._sent = 0
        #: when the last message was put; and its number told by us
        self._put_s = self._told_s = float("-inf")
        super().__init__(bus, publisher)  # known to the bus from here on, whose threads remind it

    def put(self, payload: bytes) -> None:
        with self._lock:  # messages leave in the order they are numbered
            if self._closed:
                raise BusError(f"the publisher of {self._key!r} is closed")
            try:
                self._publisher.put(payload)
                self._sent += 1
                self._put_s = time.monotonic()
            except BaseException as error:
                if not is_zenohs(error):
                    raise
                raise BusError(f"could not publish on {self._key!r} ({said(error)})") from error

    def due(self, now_s: float) -> bool:
        """Whether it is time to tell the number of the last message."""
        put_s, told_s = self._put_s, self._told_s
        soon = self._stream and told_s < put_s
        return now_s - max(put_s, told_s) >= (_HEARTBEAT_S if soon else _REPEAT_S) and now_s - put_s < _REPEATED_S

    def remind(self, session: zenoh.Session) -> None:
        """Tell readers the number of the last message, as zenoh's own heartbeat does: who lacks it asks for it."""
        if self._plain is not None or not self._sent or self._closed:
            return
        self._told_s = time.monotonic()
        number = ext.z_serialize(ext.UInt32((self._sent - 1) % (1 << 32)))
        with contextlib.suppress(zenoh.ZError):  # closed meanwhile
            session.put(f"{self._key}/@adv/pub/{self._whose.zid}/{self._whose.eid}/_", number)

    @property
    def wanted(self) -> bool:
        if self._plain is None:
            return True
        try:
            return bool(self._plain.matching_status.matching)  # type: ignore[attr-defined] # its stub has it wrong
        except zenoh.ZError:
            return False  # it is closed


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
