"""What a subscriber iterates over, with `for` or `async for`: one queue of bounded length between the bus and the program."""

import asyncio
import contextlib
import logging
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, TypeVar

from bridge.bus.contract import Message, Subscription
from bridge.wire.messages import CorrectedBatch
from estimator.door import Door
from estimator.lateness import Lateness
from estimator.once import Miss, Missing, Once, OnceKnobs

T = TypeVar("T")
log = logging.getLogger(__name__)
_CHUNK = 4096  # messages taken from the queue at a time
_WAIT_S = 1.0
#: who named somebody of whom nothing has come for so long is told so, s
_NOTHING_S = 5.0


class Stream(Generic[T]):
    """An iterator over messages of one kind, to be read by one thread or one task.

    A program that reads too slowly hurts only itself: of what waits for it the oldest is dropped, counted in `dropped` and,
    the first time, told in the log.
    """

    def __init__(
        self,
        subscription: Subscription,
        door: Door[T],
        idle_s: float | None = None,
        wanted: Callable[[T], bool] = lambda _: True,
        nothing: str = "",
    ) -> None:
        """nothing: what is said, once, where nothing comes at first."""
        self._subscription, self._door, self._wanted = subscription, door, wanted
        self._nothing, self._begun = nothing, time.monotonic()
        self._ready: deque[T] = deque()
        self._told = False
        self._loop: _InALoop[T] | None = None
        self.idle_s = idle_s

    @property
    def refused(self) -> dict[str, int]:
        """Messages that were not understood, by reason."""
        return self._door.refused.as_dict()

    @property
    def missed(self) -> int:
        """Messages known to be lost, on the way or because this program was too slow."""
        return self._subscription.missed

    @property
    def dropped(self) -> int:
        """Messages lost because this program was too slow."""
        return self._subscription.overflowed

    def receive(self, timeout_s: float) -> T | None:
        """The next message with something new, or None when none came in time."""
        return self.pop() if self.wait(timeout_s) else None

    def drain(self, timeout_s: float = 0.0) -> list[T]:
        """What has come, waiting at most timeout_s for the first."""
        self.wait(timeout_s)
        found: list[T] = []
        while (one := self.pop()) is not None:
            found.append(one)
        return found

    def latest(self) -> T | None:
        """The last of what has come since the last call, or None."""
        return next(reversed(self.drain()), None)

    def __iter__(self) -> Iterator[T]:
        while True:
            one = self.receive(_WAIT_S if self.idle_s is None else self.idle_s)
            if one is not None:
                yield one
            elif self.ended():
                return

    def __aiter__(self) -> AsyncIterator[T]:
        # One for all loops over it: what one that was left still waits for, comes in the next.
        if self._loop is None or self._loop.over:
            self._loop = _InALoop(self)
        return self._loop

    def close(self) -> None:
        """Stop receiving; iterating ends at once."""
        self._subscription.close()
        self._ready.clear()

    def wait(self, timeout_s: float) -> bool:
        """Whether there is something to pop, within timeout_s."""
        deadline = time.monotonic() + timeout_s
        while not self._any() and self._fill(max(0.0, deadline - time.monotonic())):
            pass
        return self._any()

    def pop(self) -> T | None:
        """The next of what is ready, or None."""
        return self._ready.popleft() if self._ready else None

    def ended(self, *, idle: bool = True) -> bool:
        """Whether nothing more is to be waited for; idle: nothing came for idle_s."""
        return self._subscription.closed or (idle and self.idle_s is not None)

    def _any(self) -> bool:
        return bool(self._ready)

    def _fill(self, timeout_s: float) -> bool:
        """Take what the queue has, waiting for a first message; False when nothing came in all that time."""
        messages = self._subscription.drain(_CHUNK, timeout_s)
        if self._nothing and (messages or time.monotonic() - self._begun > _NOTHING_S):
            if not messages:
                log.warning("%s", self._nothing)
            self._nothing = ""
        self._take(messages)
        if not self._told and self._subscription.overflowed:
            self._told = True
            log.warning(
                "%s messages come faster than this program reads them: the oldest are dropped, from now on only counted",
                self._door.name,
            )
        return bool(messages)

    def _take(self, messages: Sequence[Message]) -> None:
        taken = map(self._door.take, messages)
        self._ready += [one for one in taken if one is not None and self._wanted(one)]


class Corrected(Stream[CorrectedBatch]):
    """An iterator over corrected batches: each sample once and in order, over restarts of estimator and router.

    What is given more than a second later than it should be is flagged `SampleFlag.LATE`, whoever held it up: the way, a hole
    before it that was waited for, or a program that does not read. So is what waited while the device's next boot began,
    or a later owner said what came before it.
    on_miss is called for each hole when it is given up, between the batch before it and the batch after it.
    """

    def __init__(
        self,
        subscription: Subscription,
        door: Door[CorrectedBatch],
        idle_s: float | None = None,
        knobs: OnceKnobs | None = None,
        on_miss: Callable[[Miss], None] | None = None,
        nothing: str = "",
    ) -> None:
        super().__init__(subscription, door, idle_s, nothing=nothing)
        self._once, self._on_miss, self._lateness = Once(knobs), on_miss, Lateness()

    @property
    def repeated(self) -> int:
        """Samples that came again and were left out."""
        return self._once.left_out.as_dict().get("repeated", 0)

    @property
    def late(self) -> int:
        """Samples that came when they had been given up, and were left out."""
        return self._once.left_out.as_dict().get("late", 0)

    @property
    def outdated(self) -> int:
        """Samples from an estimator whose device it was no more, left out: who has it said them, or they were too many."""
        return self._once.left_out.as_dict().get("outdated", 0)

    @property
    def missing(self) -> dict[str, Missing]:
        """What did not come, by device: how many samples, and the last few holes."""
        return dict(self._once.missing)

    def pop(self) -> CorrectedBatch | None:
        """The next batch that is ready, or None."""
        while self._once.ready:
            event = self._once.ready.popleft()
            if isinstance(event, CorrectedBatch):
                return self._lateness.marked(event, time.time())
            if self._on_miss is not None:
                self._on_miss(event)
        return None

    def close(self) -> None:
        """Stop receiving; iterating ends at once."""
        super().close()
        self._once.ready.clear()

    def ended(self, *, idle: bool = True) -> bool:
        """Whether nothing more is to be waited for: then what is held comes, and the end."""
        if not super().ended(idle=idle):
            return False
        if not self._subscription.closed:
            self._once.rest()
        return not self._any()

    def _any(self) -> bool:
        return bool(self._once.ready)

    def _fill(self, timeout_s: float) -> bool:
        now, due = time.monotonic(), self._once.due()
        for_s = timeout_s if due is None else max(0.0, min(timeout_s, due - now))
        if super()._fill(for_s):
            # All that came until then has been taken from the queue, however slow the program is.
            self._once.overdue(now)
            return True
        if due is None or due - now > timeout_s or self._subscription.closed:
            return False
        self._once.overdue(due)
        return True

    def _take(self, messages: Sequence[Message]) -> None:
        now = time.monotonic()
        for message in messages:
            if (batch := self._door.take(message)) is not None:
                self._once.feed(batch, now)


class _InALoop(AsyncIterator[T]):
    """A stream in an event loop: a thread waits and takes whole queues at a time, and the loop reads what it has taken.

    They take turns, so what a slow program has not read yet waits in the bounded queue and nowhere else. A read that is
    cancelled loses nothing: the next one finds what it has waited for.
    """

    def __init__(self, stream: Stream[T]) -> None:
        self._stream = stream
        self._thread = ThreadPoolExecutor(1, "subscriber")
        self._waiting: Future[bool] | None = None
        self.over = False

    async def __anext__(self) -> T:
        stream, idle_s = self._stream, self._stream.idle_s
        # Not longer at a time: a program that ends waits for the thread.
        at_once_s = _WAIT_S if idle_s is None else min(_WAIT_S, idle_s)
        began = time.monotonic()
        while not self.over:
            if self._waiting is None:
                if (one := stream.pop()) is not None:
                    return one
                self._waiting = self._thread.submit(stream.wait, at_once_s)
            waiting = self._waiting
            await _done(waiting)
            if self._waiting is waiting:
                self._waiting = None
            idle = idle_s is not None and time.monotonic() - began >= idle_s
            if not waiting.result() and stream.ended(idle=idle):
                self.over = True
                self._thread.shutdown(wait=False)
        raise StopAsyncIteration


async def _done(work: "Future[bool]") -> None:
    loop, done = asyncio.get_running_loop(), asyncio.Event()

    def tell(_: "Future[bool]") -> None:
        with contextlib.suppress(RuntimeError):  # the loop is closed, and nobody waits any more
            loop.call_soon_threadsafe(done.set)

    work.add_done_callback(tell)
    await done.wait()
