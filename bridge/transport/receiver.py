"""One thread that receives for every network device, so that hundreds of them do not wake hundreds of threads.

What comes is stamped and kept at once; whoever wants it may be late.
"""

import contextlib
import os
import select
import threading
import time
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar

# After each look, so that one look finds what came of many devices. Stamps are late by no more, and seldom by much.
_GATHER_S = 0.002
_MOST_BYTES = 1 << 20

T = TypeVar("T")
Receive = Callable[[], None]


class Kept(Generic[T]):
    """What waits to be read, in order; bounded by its bytes. One thread puts, one takes; `end` is for any."""

    def __init__(self) -> None:
        self._queue: SimpleQueue[tuple[int, T] | None] = SimpleQueue()
        self._in = self._out = 0  # bytes, each counted by one thread

    @property
    def full(self) -> bool:
        """There is no room for more."""
        return self._in - self._out >= _MOST_BYTES

    def put(self, item: T, size: int) -> None:
        """Keep it, though it may be a little more than there is room for."""
        self._in += size
        self._queue.put((size, item))

    def take(self, timeout_s: float) -> T | None:
        """The next; None if there is none within timeout_s, or at an end."""
        try:
            kept = self._queue.get(block=timeout_s > 0, timeout=timeout_s or None)
        except Empty:
            return None
        if kept is None:
            return None
        size, item = kept
        self._out += size
        return item

    def end(self) -> None:
        """Wake whoever waits."""
        self._queue.put(None)


class Receiver:
    """Calls `receive` of each file that has something, from its own thread, which lives while there is any."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._receives: dict[int, Receive] = {}
        self._thread: threading.Thread | None = None

    def add(self, fd: int, receive: Receive) -> None:
        """From now on; `receive` must not wait, and may be called with nothing there."""
        with self._lock:
            if self._thread is None:
                self._epoll, self._wake = select.epoll(), os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
                self._epoll.register(self._wake, select.EPOLLIN)
                self._thread = threading.Thread(
                    target=self._run, args=(self._epoll, self._wake), name="network", daemon=True
                )
                self._thread.start()
            self._epoll.register(fd, select.EPOLLIN)
            self._receives[fd] = receive

    def remove(self, fd: int) -> None:
        """No longer, though a call may still be under way; to be said before the file is closed. Nothing if it is unknown."""
        ended: threading.Thread | None = None
        with self._lock:
            if self._receives.pop(fd, None) is None:
                return
            with contextlib.suppress(OSError):
                self._epoll.unregister(fd)
            if not self._receives:
                ended, self._thread = self._thread, None
                os.eventfd_write(self._wake, 1)
        if ended is not None and ended is not threading.current_thread():
            ended.join(1.0)

    def _run(self, epoll: select.epoll, wake: int) -> None:
        try:
            while True:
                ready = epoll.poll()
                for fd, _ in ready:
                    if fd == wake:
                        return
                    if (receive := self._receives.get(fd)) is not None:
                        receive()
                time.sleep(_GATHER_S)
        finally:
            epoll.close()
            os.close(wake)


RECEIVER = Receiver()
