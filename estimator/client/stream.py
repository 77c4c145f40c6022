"""Iterators over bus messages, for `for` and `async for`, with a bounded queue between the bus and the program."""

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
_CHUNK = 4096  # most messages taken from the queue at a time
#: longest single wait, s: a program that exits waits for its event loop's thread
_WAIT_S = 1.0
#: log a warning when the named devices have sent nothing for this long, s
NOTHING_S = 5.0


class Stream(AsyncIterator[T], Generic[T]):
    """Iterator over messages of one kind, for one thread or for the tasks of one event loop.

    decoder: converts bus messages to T; invalid messages are skipped and counted. wanted(message): True if the message
    is to be delivered. idle_s: iteration ends after this time without a message, or when the stream or its client is
    closed.
    nothing: warning to log if no message arrives within NOTHING_S; empty for no warning.

    If a program reads too slowly, the oldest unread messages are dropped, counted in `dropped`, and logged once. Other
    programs are not affected.
    """

    def __init__(
        self,
        subscription: Subscription,
        decoder: Decoder[T],
        idle_s: float | None = None,
        wanted: Callable[[T], bool] = lambda _: True,
        nothing: str = "",
    ) -> None:
        """nothing: the warning logged once if no message has arrived within NOTHING_S."""
        self._subscription, self._decoder, self._idle_s, self._wanted = subscription, decoder, idle_s, wanted
        self._nothing, self._begun_s, self._slow = nothing, time.monotonic(), False
        self._ready: deque[Any] = deque()
        self._thread = ThreadPoolExecutor(1, "subscriber")  # started by the first `async for`

    @property
    def refused(self) -> dict[str, int]:
        """Number of messages that could not be decoded, by reason."""
        return self._decoder.refused.as_dict()

    @property
    def missed(self) -> int:
        """Number of messages lost in transit, or because this program was too slow."""
        return self._subscription.missed

    @property
    def dropped(self) -> int:
        """Number of messages lost because this program was too slow."""
        return self._subscription.overflowed

    @property
    def caught_up(self) -> bool:
        """True if the history has arrived: the messages that publishers kept for new subscribers."""
        return self._subscription.caught_up

    def receive(self, timeout_s: float) -> T | None:
        """Return the oldest unread message, or None if none arrives within timeout_s seconds; waits for it."""
        return self.pop() if self.wait(timeout_s) else None

    def drain(self, timeout_s: float = 0.0) -> list[T]:
        """Return all unread messages, oldest first.

        If there is none, waits at most timeout_s seconds for the first; the result may be empty.
        """
        self.wait(timeout_s)
        return list(iter(self.pop, None))

    def latest(self) -> T | None:
        """Return the newest message since the last call, or None if there is none.

        Does not wait. Older messages are discarded.
        """
        return next(reversed(self.drain()), None)

    def collect(self, for_s: float) -> list[T]:
        """Return all messages that arrive within for_s seconds, oldest first, and close the stream."""
        deadline, found = time.monotonic() + for_s, list[T]()
        while (left_s := deadline - time.monotonic()) > 0.0:
            found += self.drain(left_s)
        self.close()
        return found

    def wait(self, timeout_s: float) -> bool:
        """Wait up to timeout_s seconds for a message; returns True if `pop` can return one."""
        deadline = time.monotonic() + timeout_s
        while not self._ready and self._take(max(0.0, deadline - time.monotonic())):
            pass
        return bool(self._ready)

    def pop(self) -> T | None:
        """Return the oldest unread message that `wait` has fetched, or None; does not wait."""
        return self._ready.popleft() if self._ready else None

    def close(self) -> None:
        """Stop receiving and discard unread messages; iteration ends at once."""
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
        # A thread waits and the loop reads what the thread took, so a cancelled read loses no message.
        since_s = time.monotonic()
        while (one := self.pop()) is None:
            if await asyncio.get_running_loop().run_in_executor(self._thread, self._over, since_s):
                raise StopAsyncIteration
        return one

    def _over(self, since_s: float) -> bool:
        """Wait a while; whether the stream, silent since `since_s`, has ended."""
        left_s = inf if self._idle_s is None else since_s + self._idle_s - time.monotonic()
        if self.wait(min(_WAIT_S, left_s)):
            return False
        return self._subscription.closed or (left_s <= _WAIT_S and not self._flush())

    def _flush(self) -> bool:
        """Release messages held back, if any; whether one is ready now."""
        return False

    def _take(self, timeout_s: float) -> int:
        """Take messages from the queue, waiting up to timeout_s for the first; returns their number."""
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
                "%s messages come faster than this program reads them: the oldest are dropped (further drops: counted only)",
                self._decoder.name,
            )
        return len(messages)

    def _add(self, one: T) -> None:
        self._ready.append(one)


class Corrected(Stream[CorrectedBatch]):
    """Iterator over corrected batches: each sample once and in order, also across restarts of estimator and router.

    idle_s, nothing: as in Stream. wait_s: time to wait for missing samples.
    on_miss: called for each gap that is not filled, between the batch before it and the batch after it.
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
        """Number of samples left out because they were duplicates, or arrived after being reported as missing."""
        return self._buffer.repeated

    @property
    def missing(self) -> dict[str, int]:
        """Number of samples reported as missing, by device id."""
        return dict(self._buffer.missing)

    def pop(self) -> CorrectedBatch | None:
        """Return the earliest unread batch that `wait` has fetched, in order of samples, or None; does not wait.

        Gaps before the batch are reported to on_miss.
        """
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
        if came < _CHUNK:  # every message received by `now` is in the buffer, however slow the program is
            self._buffer.overdue(now)
        return came

    def _add(self, one: CorrectedBatch) -> None:
        self._buffer.feed(one, time.monotonic())
