"""That a session keeps what it said is announced anew every few seconds, for routers that have lost it.

After a line between routers was cut, zenoh 1.10.2 now and then takes what is asked at one to none of the caches at the other, or
not to all of them, while samples pass. It does again once anything is declared there that the question may be for
(docs/cluster.md).
"""

from collections import defaultdict, deque
from collections.abc import Iterable
from functools import partial
from itertools import count

import zenoh
from zenoh import handlers

from bridge.bus.zenoh_session import Home, each

#: so many of each are there at once: one that is taken back takes with it what was asked of it just then
_AT_ONCE = 2
_QUESTIONS = 256


class Announced:
    """Of one session; what is announced has no answer to anything, and says so at once."""

    def __init__(self, home: Home, session: zenoh.Session) -> None:
        self._home, self._session = home, session
        self._there = defaultdict[str, deque[zenoh.Queryable[handlers.Handler[zenoh.Query]]]](deque)
        self._numbers = count()

    def anew(self, places: Iterable[str]) -> None:
        """All places: keys with wildcards below which caches answer."""
        name = f"again-{next(self._numbers) % (_AT_ONCE + 1)}"
        for place in places:
            queryable = self._session.declare_queryable(f"{place}/{name}", handlers.RingChannel(_QUESTIONS))
            self._home.run(partial(each, queryable.handler, _nothing), f"{name} of {place}")
            there = self._there[place]
            there.append(queryable)
            if len(there) > _AT_ONCE:
                there.popleft().undeclare()  # type: ignore[no-untyped-call]


def _nothing(query: zenoh.Query) -> None:
    with query:  # leaving tells that no more is to come
        pass
