"""Gap repair: a session's worker thread that fetches missed messages from the caches of other publishers.

The same thread answers queries to the session's own caches, and calls the handlers of liveliness watchers and queries.
"""

import logging
import os
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import count
from typing import Any, TypeVar

import zenoh
from zenoh import handlers

from bridge.bus.publisher_cache import HISTORY, PARAMETERS, SESSION_BYTES, Cache, Caches, Source
from bridge.bus.zenoh_session import CHANNEL, said
from bridge.bus.zenoh_subscription import Found, Subscription, by_source

_T = TypeVar("_T")
_log = logging.getLogger(__name__)

#: poll interval of the channels, idle and while answers are pending: zenoh cannot wait for several channels at once
_TICK_S, _TURN_S = 0.025, 0.005
#: timeout of a cache query, and the time after which a query counts as over even if zenoh does not end it
PAST_S = 2.0
_OVER_S = 2 * PAST_S
#: interval of asking paused publishers for their last message number: no later message would reveal its loss
_LAST_S = 2.0
#: only publishers silent for less than this are asked; for some seconds after a router returns, the outage is added
_LAST_WITHIN_S, _AFTER_S = 40.0, 10.0
#: queries that may wait; more drop the oldest, and the asker repeats its query
_QUESTIONS = 4096
#: queries and tokens handled in a row, before the thread turns to its other work
_AT_ONCE = 1024


@dataclass(slots=True, eq=False)
class _Question:
    replies: handlers.Handler[zenoh.Reply]
    then: Callable[[Found], None]
    over_s: float
    found: list[zenoh.Sample] = field(default_factory=list)

    def over(self) -> bool:
        """Take the replies received so far; return whether the query is complete."""
        try:
            while (reply := self.replies.try_recv()) is not None:
                if reply.ok is not None:
                    self.found.append(reply.ok)
        except zenoh.ZError:
            return True
        return time.monotonic() >= self.over_s


class GapRepair:
    """Worker that fetches the messages missed by one session's subscriptions, and answers queries to the session's caches.

    subscriptions: returns the session's open subscriptions. `run` is the body of the worker thread. All other methods
    may be called from any thread.
    """

    def __init__(self, session: zenoh.Session, subscriptions: Callable[[], Iterator[Subscription]]) -> None:
        self._session, self._subscriptions = session, subscriptions
        self._name, self._numbers, self._lock = os.urandom(SESSION_BYTES), count(), threading.Lock()
        self._caches, self._cached = Caches(), 0
        self._asked: dict[str, handlers.Handler[zenoh.Query]] = {}
        self._queryables = list[object]()  # zenoh undeclares an object without a reference
        self._watched = list[tuple[handlers.Handler[Any], Callable[[Any], None]]]()
        self._questions = list[_Question]()
        self._last_s = 0.0
        self._routers: set[str] = set()
        self._there_s = self._changed_s = time.monotonic()

    def keep(self, key: str, size: int) -> Cache:
        """Create a cache of the last `size` messages for the publisher of a key, and start to answer queries to the cache."""
        cache = Cache(key, size, self._name, next(self._numbers))
        with self._lock:
            self._cached += size
            if (place := self._caches.add(cache)) is not None:
                asked = f"{place}/*/{HISTORY}/{self._name.hex()}".removeprefix("/")
                ring: handlers.RingChannel[zenoh.Query] = handlers.RingChannel(_QUESTIONS)
                queryable = self._session.declare_queryable(asked, ring)
                self._queryables.append(queryable)
                self._asked = self._asked | {place: queryable.handler}
        return cache

    def forget(self, cache: Cache) -> None:
        """Drop the cache of a closed publisher and stop answering queries to this cache."""
        with self._lock:
            self._cached -= cache.size
            self._caches.discard(cache)

    def watch(self, channel: handlers.Handler[_T], handle: Callable[[_T], None]) -> None:
        """Call handle(item) for each item (token change or query) in a zenoh channel, on the worker thread.

        Ends when the channel closes. handle must not raise.
        """
        self._watched = [*self._watched, (channel, handle)]

    def begin(self, subscription: Subscription, most: int | None) -> None:
        """Fetch from publishers' caches the messages sent before a new subscription; deliver them to this subscription.

        most: number of newest messages to fetch from each publisher; None for all.
        """
        what = "" if most is None else f"most={most}"
        left, past = [len(subscription.patterns)], Found()

        def came(found: Found) -> None:
            past.update(found)
            left[0] -= 1
            if not left[0]:
                subscription.begin(past)

        for pattern in subscription.patterns:
            self._ask(f"{pattern}/{HISTORY}/*", what, came)

    def past(self, place: str, what: str = "") -> handlers.Handler[zenoh.Reply]:
        """Query publishers' caches; return the zenoh channel that receives the replies, for at most PAST_S (2) seconds.

        place: `KEY/@adv/SESSION`. KEY is the publishers' key or key pattern, SESSION a session id in hexadecimal or
        `*`. what: query parameters, such as `most=10`, as listed in `publisher_cache`; "" for all messages.
        """
        return self._session.get(
            f"{place}?{what}",
            handlers.FifoChannel(CHANNEL + self._cached),  # room for every answer of this thread's own caches
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
            timeout=PAST_S,
        )

    def run(self, over: Callable[[], bool]) -> None:
        """Run the worker loop in the calling thread until over() is True: answer queries, deliver messages, repair gaps."""
        while not over():
            time.sleep(_TURN_S if self._questions else _TICK_S)
            try:
                self._answer()
                self._hand_on()
                self._listen()
                for subscription in self._subscriptions():
                    subscription.poll()
                self._ask_about_gaps()
                if time.monotonic() >= self._last_s + _LAST_S:
                    self._last_s = time.monotonic()
                    self._ask_for_last()
            except zenoh.ZError as error:
                if not self._session.is_closed():
                    _log.error(
                        "missed messages could not be fetched again: %s; messages missed later are fetched as usual",
                        said(error),
                    )

    def _ask(self, place: str, what: str, then: Callable[[Found], None]) -> None:
        self._questions.append(_Question(self.past(place, what), then, time.monotonic() + _OVER_S))

    def _answer(self) -> None:
        """Answer queries to this session's caches."""
        for place, questions in self._asked.items():
            for _ in range(_AT_ONCE):
                if (query := questions.try_recv()) is None:
                    break
                with query:  # leaving ends the reply
                    pattern = str(query.key_expr).rpartition(f"/{HISTORY}/")[0]
                    asked = {name: value for name in PARAMETERS if (value := query.parameters.get(name)) is not None}
                    try:
                        for cache, (number, payload) in self._caches.found(place, pattern, asked):
                            query.reply(cache.key, payload, attachment=cache.stamp(number))
                    except (ValueError, KeyError, zenoh.ZError) as error:
                        _log.debug("%s was not answered: %s", pattern, error)

    def _hand_on(self) -> None:
        """Deliver complete answers of other publishers' caches."""
        for question in list(self._questions):
            if question.over():
                self._questions.remove(question)
                question.then(by_source(question.found))

    def _listen(self) -> None:
        """Handle the tokens and queries received."""
        for watched in self._watched:
            channel, handle = watched
            try:
                for _ in range(_AT_ONCE):
                    if (one := channel.try_recv()) is None:
                        break
                    handle(one)
            except zenoh.ZError:
                self._watched = [one for one in self._watched if one is not watched]

    def _ask_about_gaps(self) -> None:
        for subscription in self._subscriptions():
            for source, start in subscription.due():

                def then(found: Found, to: Subscription = subscription, source: Source = source) -> None:
                    to.answered(source, found)

                try:
                    self._ask(source.place, f"publisher={source.publisher};from={start}", then)
                except zenoh.ZError as error:  # published under a key that cannot be queried
                    _log.debug("the query to cache %s failed: %s", source.key, said(error))
                    then({})

    def _ask_for_last(self) -> None:
        now_s, routers = time.monotonic(), {str(zid) for zid in self._session.info.routers_zid()}
        if routers != self._routers:
            self._routers, self._changed_s = routers, now_s
        within_s = _LAST_WITHIN_S
        if now_s - self._changed_s < _AFTER_S:
            within_s += now_s - self._there_s
        elif routers:
            self._there_s = now_s
        for subscription in self._subscriptions():
            if subscription.repaired and subscription.caught_up:
                for pattern in subscription.patterns:
                    self._ask(f"{pattern}/{HISTORY}/*", f"last={within_s:.0f}", subscription.heard)
