"""Shared computation of expensive responses: done once for equal requests, and skipped when no client waits."""

import asyncio
import time
from collections import Counter, OrderedDict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from http import HTTPStatus
from typing import Generic, TypeVar

from starlette.requests import Request

from estimator.web.http_error import Fault

T = TypeVar("T")

#: most different answers waiting or in progress, and most answers kept
WAITING, KEPT = 8, 16
#: longest wait of a request for a place among those, s
PATIENCE_S = 1.0


class SharedWork(Generic[T]):
    """Computation of answers on its own thread, one at a time; requests with equal keys share one for `keep_s` s."""

    def __init__(self, keep_s: float) -> None:
        self._keep_s = keep_s
        self._one_at_a_time = asyncio.Lock()
        self._thread = ThreadPoolExecutor(1)  # of its own: the system keeps freed memory for each thread that drew
        self._made: OrderedDict[str, tuple[float, T]] = OrderedDict()
        self._tasks: dict[str, asyncio.Task[T | None]] = {}
        self._askers = Counter[str]()

    async def get(self, request: Request, key: str, make: Callable[[], T]) -> T:
        """Return the answer for a key: a kept one, or the result of make(), which runs on a thread.

        key: equal for requests with equal answers. request: the computation is skipped if all clients with this key
        have disconnected.
        Raises Fault if too many answers for other keys are awaited, or if the client has disconnected.
        """
        made_s, answer = self._made.get(key, (float("-inf"), None))
        if answer is not None and time.monotonic() - made_s < self._keep_s:
            return answer
        refuse_s = time.monotonic() + PATIENCE_S
        while key not in self._askers and len(self._askers) >= WAITING:
            if time.monotonic() > refuse_s:
                words = "Too many requests of this kind are running; try again."
                raise Fault(HTTPStatus.SERVICE_UNAVAILABLE, "busy", words, {"Retry-After": "5"})
            await asyncio.sleep(0.05)
        if key not in self._tasks:
            self._tasks[key] = asyncio.create_task(self._make(key, make))
            self._tasks[key].add_done_callback(
                lambda made: made.cancelled() or made.exception()
            )  # nobody may be left to read the exception
        task = self._tasks[key]
        self._askers[key] += 1
        leaves = asyncio.create_task(_left(request))
        try:
            await asyncio.wait({task, leaves}, return_when=asyncio.FIRST_COMPLETED)
            if not task.done() or (answer := task.result()) is None:
                raise Fault(
                    HTTPStatus.REQUEST_TIMEOUT,
                    "incomplete",
                    "The client closed the connection.",
                    {"Connection": "close"},
                )
            return answer
        finally:
            leaves.cancel()
            self._askers[key] -= 1
            if not self._askers[key]:
                del self._askers[key]

    async def _make(self, key: str, make: Callable[[], T]) -> T | None:
        try:
            async with self._one_at_a_time:
                if key not in self._askers:
                    return None
                answer = await asyncio.get_running_loop().run_in_executor(self._thread, make)
            self._made[key] = time.monotonic(), answer
            self._made.move_to_end(key)
            while len(self._made) > KEPT:
                self._made.popitem(last=False)
            return answer
        finally:
            del self._tasks[key]


async def _left(request: Request) -> None:
    """Wait until the client has closed its connection."""
    while (await request.receive())["type"] != "http.disconnect":
        pass
