"""What a subscriber iterates over, with `for` or `async for`: one queue of bounded length between the bus and the program."""

import asyncio
import logging
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from math import inf
from typing import Any, Generic, TypeVar

from bridge.bus.contract import Subscription
from bridge.wire import codec
from bridge.wire.messages import CorrectedBatch
from estimator.client.decoder import Decoder
from estimator.client.reorder_buffer import WAIT_S, Miss, ReorderBuffer

T = TypeVar("T")
log = logging.getLogger(__name__)
_CHUNK = 4096  # messages taken from the queue at a time
#: a stream is waited for no longer at a time: a program that ends waits for the thread of an event loop
_WAIT_S = 1.0
#: named devices of which nothing has come for so long are told in the log, s
NOTHING_S = 5.0


class Stream(AsyncIterator[T], Generic[T]):
    """An iterator over messages of one kind, for one thread, or for tasks of one event loop.

    Iterating ends after idle_s seconds without a message, or when the stream or its client is closed. A program that reads too
    slowly hurts only itself: the oldest unread messages are dropped, counted in `dropped` and, the first time, told in the log.
    """

    def __init__(
        self,
        subscription: Subscription,
        decoder: Decoder[T],
        idle_s: float | None = None,
        wanted: Callable[[T], bool] = lambda _: True,
        nothing: str = "",
    ) -> None:
        """nothing: what the log says, once, where nothing comes at first."""
        self._subscription, self._decoder, self._idle_s, self._wanted = subscription, decoder, idle_s, wanted
        self._nothing, self._begun_s, self._slow = nothing, time.monotonic(), False
        self._ready: deque[Any] = deque()
        self._thread = ThreadPoolExecutor(1, "subscriber")  # begun by the first `async for`

    @property
    def refused(self) -> dict[str, int]:
        """Messages that were not understood, by reason."""
        return self._decoder.refused.as_dict()

    @property
    def missed(self) -> int:
        """Messages known to be lost, on the way or because this program was too slow."""
        return self._subscription.missed

    @property
    def dropped(self) -> int:
        """Messages lost because this program was too slow."""
        return self._subscription.overflowed

    def receive(self, timeout_s: float) -> T | None:
        """The next message, or None when none came in time."""
        return self.pop() if self.wait(timeout_s) else None

    def drain(self, timeout_s: float = 0.0) -> list[T]:
        """All messages that have come, waiting at most timeout_s for the first."""
        self.wait(timeout_s)
        return list(iter(self.pop, None))

    def latest(self) -> T | None:
        """The last message that has come since the last call, or None."""
        return next(reversed(self.drain()), None)

    def collect(self, for_s: float) -> list[T]:
        """All messages that come within for_s; the stream is closed then."""
        deadline, found = time.monotonic() + for_s, list[T]()
        while (left_s := deadline - time.monotonic()) > 0.0:
            found += self.drain(left_s)
        self.close()
        return found

    def wait(self, timeout_s: float) -> bool:
        """Whether there is something to pop, within timeout_s."""
        deadline = time.monotonic() + timeout_s
        while not self._ready and self._take(max(0.0, deadline - time.monotonic())):
            pass
        return bool(self._ready)

    def pop(self) -> T | None:
        """The next message that is ready, or None."""
        return self._ready.popleft() if self._ready else None

    def close(self) -> None:
        """Stop receiving; iterating ends at once."""
        self._subscription.close()
        self._ready.clear()

    def __iter__(self) -> Iterator[T]:
        while True:
            since_s = time.monotonic()
            while (one := self.pop()) is None:
                if self._over(since_s):
                    return
            yield one

    async def __anext__(self) -> T:
        # A thread waits, and the loop reads what it has taken: a read that is cancelled loses nothing.
        since_s = time.monotonic()
        while (one := self.pop()) is None:
            if await asyncio.get_running_loop().run_in_executor(self._thread, self._over, since_s):
                raise StopAsyncIteration
        return one

    def _over(self, since_s: float) -> bool:
        """Wait a while; whether nothing more is to come of a stream of which nothing has come since then."""
        left_s = inf if self._idle_s is None else since_s + self._idle_s - time.monotonic()
        if self.wait(min(_WAIT_S, left_s)):
            return False
        return self._subscription.closed or (left_s <= _WAIT_S and not self._flush())

    def _flush(self) -> bool:
        """Whether something was held back that is ready now."""
        return False

    def _take(self, timeout_s: float) -> int:
        """Take messages from the queue, waiting for a first one; how many there were: 0 if none came in all that time."""
        messages = self._subscription.drain(_CHUNK, timeout_s)
        if self._nothing and (messages or time.monotonic() - self._begun_s > NOTHING_S):
            if not messages:
                log.warning("%s", self._nothing)
            self._nothing = ""
        for message in messages:
            if (one := self._decoder.take(message)) is not None and self._wanted(one):
                self._add(one)
        if not self._slow and self._subscription.overflowed:
            self._slow = True
            log.warning(
                "%s messages come faster than this program reads them: the oldest are dropped, from now on only counted",
                self._decoder.name,
            )
        return len(messages)

    def _add(self, one: T) -> None:
        self._ready.append(one)


class Corrected(Stream[CorrectedBatch]):
    """An iterator over corrected batches: each sample of a boot once and in order, over restarts of estimator and router.

    on_miss is called for each hole when it is given up, between the batch before it and the batch after it.
    """

    def __init__(
        self,
        subscription: Subscription,
        idle_s: float | None = None,
        wait_s: float = WAIT_S,
        on_miss: Callable[[Miss], None] | None = None,
        nothing: str = "",
    ) -> None:
        super().__init__(subscription, Decoder("corrected", codec.decode_corrected), idle_s, nothing=nothing)
        self._buffer, self._on_miss = ReorderBuffer(wait_s), on_miss
        self._ready = self._buffer.ready

    @property
    def repeated(self) -> int:
        """Samples that were left out: they came again, or after they had been told as missing."""
        return self._buffer.repeated

    @property
    def missing(self) -> dict[str, int]:
        """Samples that did not come, by device."""
        return dict(self._buffer.missing)

    def pop(self) -> CorrectedBatch | None:
        """The next batch that is ready, or None."""
        while self._buffer.ready:
            event = self._buffer.ready.popleft()
            if isinstance(event, CorrectedBatch):
                return event
            if self._on_miss is not None:
                self._on_miss(event)
        return None

    def _flush(self) -> bool:
        self._buffer.overdue(inf)
        return bool(self._ready)

    def _take(self, timeout_s: float) -> int:
        now, due_s = time.monotonic(), self._buffer.due()
        came = super()._take(max(0.0, min(timeout_s, due_s - now)))
        if not came and due_s <= now + timeout_s and not self._subscription.closed:
            self._buffer.overdue(max(now, due_s))
            return 1
        if came < _CHUNK:  # all that had come by `now` is in the buffer, however slow the program is
            self._buffer.overdue(now)
        return came

    def _add(self, one: CorrectedBatch) -> None:
        self._buffer.feed(one, time.monotonic())
