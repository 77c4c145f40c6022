"""ZenohBus: implementation of the bus interface `contract.Bus` on zenoh, with publish, subscribe, query and liveliness."""

import atexit
import contextlib
import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Self

import zenoh
from zenoh import handlers

from bridge.bus import zenoh_settings
from bridge.bus.contract import BusError, Reply
from bridge.bus.gap_repair import GapRepair
from bridge.bus.key_expressions import check_key, check_pattern, check_patterns
from bridge.bus.publisher_cache import HISTORY
from bridge.bus.router_watch import why_unreachable
from bridge.bus.routers import Routers
from bridge.bus.zenoh_publisher import Publisher
from bridge.bus.zenoh_session import (
    CHANNEL,
    Declared,
    as_bus_error,
    close_session,
    open_session,
)
from bridge.bus.zenoh_subscription import Subscription

_log = logging.getLogger(__name__)

_JOIN_S = 1.0


class ZenohBus:
    """Session on the bus (`contract.Bus`), as a client of one or more zenoh routers. Reconnects automatically until closed.

    endpoints: router endpoints, for example `tcp/127.0.0.1:7447`, in order of preference. The first that answers is
    used; the others replace it when it is lost. Give `Routers` to authenticate with a certificate.
    open_timeout_s: seconds to wait for a router.
    Raises BusError if no router answers within open_timeout_s, and at once if the certificate cannot be used.
    """

    def __init__(self, endpoints: Sequence[str], *, open_timeout_s: float = 3.0) -> None:
        routers = Routers.of(endpoints)
        self._where = ", ".join(endpoints)
        if not endpoints:
            raise BusError("no router to connect to: name one, for example tcp/127.0.0.1:7447")
        if wrong := routers.faults():
            raise BusError("; ".join(wrong))
        try:
            self._session = open_session(zenoh_settings.client(endpoints, routers.identity), "", open_timeout_s)
        except BusError as error:
            raise BusError(
                f"no router answered at {self._where} within {open_timeout_s:g} s{_why(routers)}{error}"
            ) from error.__cause__
        self.declared: set[Declared] = set()  # zenoh undeclares an object without a reference
        self._threads: set[threading.Thread] = set()
        self._closed = False
        self._repair = GapRepair(self._session, self._subscriptions)
        self.run(lambda: self._repair.run(lambda: self._closed), "repair")
        atexit.register(self.close)

    def publisher(self, key: str, *, cache: int = 0) -> Publisher:
        """Create a publisher on a key without wildcards. See contract.Bus.

        cache: number of latest messages to keep for late subscribers; 0 for no cache. Raises BusError for an invalid
        key.
        """
        with self._doing(f"publish on {check_key(key)}"):
            # BLOCK: DROP silently loses two thirds at saturation, and bursts of a few thousand. The router cuts off a
            # frozen reader after CUT_OFF_S, which bounds the wait of a put.
            made = self._session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
            return Publisher(self, made, key, self._repair.keep(key, cache) if cache > 0 else None)

    def forget(self, declared: Declared) -> None:
        """Remove a closed handle from the session's open handles; if it is a publisher with a cache, drop the cache."""
        self.declared.discard(declared)
        if isinstance(declared, Publisher) and declared.cache is not None:
            self._repair.forget(declared.cache)

    def subscribe(
        self,
        patterns: str | Sequence[str],
        *,
        history: bool = False,
        capacity: int = 65536,
        most_past: int | None = None,
        prompt: bool = True,
    ) -> Subscription:
        """Subscribe to one or several key patterns, with one queue; contract.Bus explains the parameters.

        history: use True only where publishers have a cache. A message may be lost if it is the first of its publisher
        and sent within about 5 ms of this call. capacity, most_past: numbers of messages. prompt: True delivers at
        once.
        Raises BusError for an invalid pattern.
        """
        patterns = check_patterns(patterns)
        with self._doing(f"subscribe to {', '.join(patterns)}"):
            found = list[zenoh.Subscriber[handlers.Handler[zenoh.Sample]]]()
            for one in patterns:
                channel: handlers.FifoChannel[zenoh.Sample] = handlers.FifoChannel(CHANNEL)
                found.append(self._session.declare_subscriber(one, channel))
            subscription = Subscription(self, found, patterns, capacity, repaired=history, prompt=prompt)
            if history:
                self._repair.begin(subscription, most_past)
            return subscription

    def answer(self, pattern: str, handler: Callable[[str, bytes, Reply], None]) -> "Declared":
        """Answer queries on matching keys by handler(key, payload, reply), on a thread of the bus. See contract.Bus.

        Raises BusError for an invalid pattern.
        """
        with self._doing(f"answer {check_pattern(pattern)}"):
            # Ring: with more pending queries than this, the oldest ends without an answer.
            queryable = self._session.declare_queryable(pattern, handlers.RingChannel(256), complete=True)
        self._repair.watch(queryable.handler, lambda query: _answer(query, handler))
        return Declared(self, queryable)

    def ask(self, key: str, payload: bytes, timeout_s: float = 2.0) -> bytes:
        """Send a query and return the payload of the first answer that is not empty. See contract.Bus.

        Raises BusError if no program answers within timeout_s seconds, or if all answers are empty or errors.
        """
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
            raise BusError(f"no program answers {key!r}: check that the estimator runs (`truerate status`)")
        raise BusError(f"{key!r} was answered with an error: {'; '.join(errors)}")

    def declare_alive(self, key: str) -> "Declared":
        """Declare a liveliness token: other sessions see the key as alive until the handle or the session is closed.

        Raises BusError for an invalid key.
        """
        with self._doing(f"declare {check_key(key)} alive"):
            return Declared(self, self._session.liveliness().declare_token(key))

    def watch_alive(self, pattern: str, on_change: Callable[[str, bool], None]) -> "Declared":
        """Watch liveliness tokens: call on_change(key, alive) for every token that exists now and for every later change.

        alive: True when a token appears, False when it disappears. Raises BusError for an invalid pattern.
        All tokens disappear when the router is lost: check `connected` before treating a device or program as gone.
        zenoh 1.10.2 may miss the end of a token that disappears in the millisecond in which the watch begins. A load
        test that timed both to coincide saw this in 3 of 1800 trials. The token then seems alive until the session
        reconnects. Only arriving data proves that a sender is alive.
        """
        with self._doing(f"watch {check_pattern(pattern)}"):
            watcher = self._session.liveliness().declare_subscriber(
                pattern, handlers.FifoChannel(CHANNEL), history=True
            )
        alive: set[str] = set()

        def tell(sample: zenoh.Sample) -> None:
            key, now = str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT
            if now != (key in alive):
                alive.symmetric_difference_update((key,))
                try:
                    on_change(key, now)
                except Exception:  # noqa: BLE001 - a handler must not stop the bus
                    _log.exception(
                        "the handler for programs that start or end under %s failed; it runs again at the next change",
                        pattern,
                    )

        self._repair.watch(watcher.handler, tell)
        return Declared(self, watcher)

    @property
    def session_id(self) -> str:
        """Id of the session, unique on the network: up to 32 hexadecimal digits."""
        return str(self._session.info.zid())

    @property
    def connected(self) -> bool:
        """True if the session is connected to a router now."""
        return not self._closed and bool(self._session.info.routers_zid())

    def past(self, pattern: str) -> handlers.Handler[zenoh.Reply]:
        """Query the caches of all publishers whose keys match a pattern; return the zenoh channel that receives the replies."""
        return self._repair.past(f"{pattern}/{HISTORY}/*")

    def _subscriptions(self) -> Iterator[Subscription]:
        return (one for one in list(self.declared) if isinstance(one, Subscription))

    def run(self, work: Callable[[], None], name: str) -> None:
        """Start a thread that runs work(); `close` waits for it. work must return when its zenoh channel closes.

        name: name of the thread.
        """

        def body() -> None:
            try:
                work()
            finally:
                self._threads.discard(thread)

        thread = threading.Thread(target=body, name=name, daemon=True)
        self._threads.add(thread)
        thread.start()

    def close(self) -> None:
        """Close the session and all its subscriptions; a second close does nothing.

        Waits up to 1 s for each thread of the session.
        """
        if self._closed:
            return
        self._closed = True
        atexit.unregister(self.close)
        for subscription in self._subscriptions():
            subscription.close()
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
    """Return causes and advice for endpoints without an answer, for the error message."""
    silent = {endpoint: words for endpoint in routers if (words := why_unreachable(endpoint))}
    said = [f"{endpoint}: {words}" if len(routers) > 1 else words for endpoint, words in silent.items()]
    if len(silent) == len(routers):
        how = f"--listen {routers[0]}" if routers.identity is None else "--config ROUTER.json5"
        return f": {'; '.join(said)}; start one with `truerate router {how}`, or correct the address"
    there = ", ".join(endpoint for endpoint in routers if endpoint not in silent)
    if routers.identity is None:
        said.append(
            f"the program at {there} may require a certificate (tls/...), or may not be a router: correct the address"
        )
    else:
        said.append(
            f"if a router runs at {there}, see its log: it may refuse this program's certificate (`truerate pki router` writes"
            " the router's files again), or the router's certificate may be for another host name"
        )
    return f": {'; '.join(said)}"


def _answer(query: zenoh.Query, handler: Callable[[str, bytes, Reply], None]) -> None:
    """Pass one query to its handler. Leaving the query's `with` block ends the reply."""
    key = str(query.key_expr)

    def reply(answer: bytes) -> None:
        try:
            with query:
                query.reply(query.key_expr, answer)
        except zenoh.ZError as error:
            _log.warning("an answer to %s could not be sent: %s", key, error)

    try:
        check_key(key)
        handler(key, query.payload.to_bytes() if query.payload is not None else b"", reply)
    except Exception as error:  # noqa: BLE001 - a handler must not stop the bus
        if not isinstance(error, BusError):
            _log.exception("the handler of queries on %s failed", key)
        with query, contextlib.suppress(zenoh.ZError):
            query.reply_err(f"{type(error).__name__}: {error}"[:500].encode())
