"""Subscriptions to corrected rates, kept only while programs read them. Runs in the event loop."""

import asyncio
import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http import HTTPStatus
from math import inf
from typing import TypeVar

from bridge.wire.messages import CorrectedBatch
from estimator.client import Client, Corrected
from estimator.web.http_error import Fault
from estimator.web.stream.cursor import Cursor, Kept, Missed, Place
from estimator.web.stream.request import Asked

T = TypeVar("T")
log = logging.getLogger(__name__)

#: interval of taking received messages, s
TAKE_S = 0.02
#: batches kept for resuming and slow readers: of one device about 30 s, as its publisher keeps; of a whole ward fewer
OF_A_DEVICE, OF_THE_WARD = 640, 16384
#: a subscription without a reader is kept for this long, s: a program that polls, or reconnects, finds it
LINGER_S = 30.0
#: the history is complete this long after it arrived, s: the reorder buffer holds the beginning for 0.1 s
SETTLE_S = 0.25
#: most readers and subscriptions at a time, and of each from one address
READERS, OF_ONE_ADDRESS = 128, 64
#: most batches handed on at a time, of all feeds of a reader; others run in between
AT_ONCE = 64
#: longest wait for what publishers kept, s; without a router it never comes
BEGIN_S = 15.0


class Feed:
    """Subscription to corrected rates, of a device or the whole ward, with a buffer of batches and its readers.

    most: size of the buffer, batches; the oldest are dropped.
    """

    def __init__(self, stream: Corrected, most: int) -> None:
        self.stream, self.kept = stream, Kept(most)
        self.readers: set[Reader] = set()
        self.unread_since_s, self._caught_up_s = time.monotonic(), float("inf")
        #: set when everything that publishers kept is here
        self.settled = asyncio.Event()

    async def take(self, now: float) -> None:
        """Move the received batches into the buffer, and wake the readers. now: monotonic time, s."""
        caught_up, drain = self.stream.caught_up, self.stream.drain
        # The history of a ward takes a second to decode: a thread does it, while pages and other readers go on.
        batches = drain() if self.settled.is_set() else await asyncio.to_thread(drain)
        self.kept.add(batches)
        if not self.settled.is_set():
            if now - self._caught_up_s >= SETTLE_S:
                self.settled.set()
            # The reorder buffer begins to hold when it is drained, which may be long after `now`.
            self._caught_up_s = min(self._caught_up_s, time.monotonic()) if caught_up else float("inf")
        if batches:
            for reader in self.readers:
                reader.news.set()


class Reader:
    """Program that reads the stream of corrected rates, with a cursor (position) in each of its feeds."""

    def __init__(self, feeds: dict[str, Feed], asked: Asked, address: str, turn: asyncio.Lock) -> None:
        self.address, self.news, self._turn = address, asyncio.Event(), turn
        self._feeds, self._asked = feeds, asked
        self._cursors: list[Cursor] = []

    async def begin(self) -> None:
        """Wait until the older batches that publishers have cached are received, then create the cursors.

        Raises Fault if they are not received within BEGIN_S seconds.
        """
        try:
            async with asyncio.timeout(BEGIN_S):
                for feed in self._feeds.values():
                    await feed.settled.wait()
        except TimeoutError:
            raise Fault(HTTPStatus.SERVICE_UNAVAILABLE, "no_router", headers={"Retry-After": "5"}) from None
        for name, feed in self._feeds.items():
            after = self._asked.after
            if after is not None and name:
                after = {name: after[name]} if name in after else {}
            self._cursors.append(Cursor(feed.kept, after, self._asked.hz))

    async def read(
        self, make: Callable[[CorrectedBatch | Missed], T], most: int = AT_ONCE, wait_s: float = inf
    ) -> list[T]:
        """Wait for samples after the reader's positions; return make(one) of each batch or report of missed samples.

        most: approximate largest number of batches to read. Empty if nothing arrives within `wait_s` seconds.
        """
        each = max(1, most // len(self._cursors))
        deadline_s = time.monotonic() + wait_s
        while True:
            self.news.clear()
            async with self._turn:
                found = [make(one) for cursor in self._cursors for one in cursor.read(each)]
                await asyncio.sleep(0)  # one reader in a round of the event loop, however many there are: pages run on
            if found:
                return found
            if any(cursor.behind for cursor in self._cursors):
                continue
            try:
                await asyncio.wait_for(self.news.wait(), None if wait_s == inf else deadline_s - time.monotonic())
            except TimeoutError:
                return []

    @property
    def places(self) -> dict[str, Place]:
        """Position in the samples of each device, by id, from which a later request can resume."""
        places = dict(self._asked.after or {})
        for cursor in self._cursors:
            places |= cursor.places
        return places


class Feeds:
    """Subscriptions of a dashboard by device id ("" for the whole ward), shared by all readers.

    Each subscription ends LINGER_S seconds after its last reader.
    """

    def __init__(self) -> None:
        self._feeds: dict[str, Feed] = {}
        self._turn = asyncio.Lock()
        self._taking: asyncio.Task[None] | None = None

    @contextmanager
    def reader(self, client: Client | None, asked: Asked, address: str) -> Iterator[Reader]:
        """Context manager with a reader of the requested devices.

        client: makes the subscriptions; None until a router is first connected. asked: parameters of the request.
        address: client address of the program; the number of readers per address is limited.
        Raises Fault if there are too many readers, or no router.
        """
        if client is None:
            raise Fault(HTTPStatus.SERVICE_UNAVAILABLE, "no_router", headers={"Retry-After": "1"})
        names = asked.devices or ("",)
        self._check_room(names, address)
        feeds = {name: self._feeds.get(name) or self._open(client, name) for name in names}
        reader = Reader(feeds, asked, address, self._turn)
        for feed in feeds.values():
            feed.readers.add(reader)
        if self._taking is None or self._taking.done():
            self._taking = asyncio.create_task(self._take())
        try:
            yield reader
        finally:
            for feed in feeds.values():
                feed.readers.discard(reader)
                if not feed.readers:
                    feed.unread_since_s = time.monotonic()

    def close(self) -> None:
        """Close all subscriptions."""
        if self._taking is not None:
            self._taking.cancel()
        for name in list(self._feeds):
            self._feeds.pop(name).stream.close()

    def _check_room(self, names: tuple[str, ...], address: str) -> None:
        readers = {reader for feed in self._feeds.values() for reader in feed.readers}
        near = sum(reader.address == address for reader in readers)
        own = sum(all(reader.address == address for reader in feed.readers) for feed in self._feeds.values())
        new = sum(name not in self._feeds for name in names)
        if len(readers) >= READERS or near >= OF_ONE_ADDRESS:
            words = f"{len(readers)} programs already read the stream, {near} of them from {address}: try again later."
        elif len(self._feeds) + new > READERS or own + new > OF_ONE_ADDRESS:
            words = "Too many single devices are read: read the whole ward, without `device`, or try again later."
        else:
            return
        raise Fault(HTTPStatus.SERVICE_UNAVAILABLE, "busy", words, {"Retry-After": "5"})

    def _open(self, client: Client, name: str) -> Feed:
        stream = client.corrected(name or None, quiet=True)
        feed = self._feeds[name] = Feed(stream, OF_A_DEVICE if name else OF_THE_WARD)
        return feed

    async def _take(self) -> None:
        """Take received messages several times a second, until no feed is left."""
        while self._feeds:
            now = time.monotonic()
            for name, feed in list(self._feeds.items()):
                await feed.take(now)
                if not feed.readers and now - feed.unread_since_s > LINGER_S:
                    self._feeds.pop(name).stream.close()
            await asyncio.sleep(TAKE_S)
