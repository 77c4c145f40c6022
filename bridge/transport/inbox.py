"""Inbox of a device: received messages on their way from a receiving thread to the device's thread, bounded."""

import threading
from collections import deque
from typing import Any, NamedTuple

from bridge.transport import host_time
from bridge.transport.transport import Chunk

_AT_ONCE_BYTES = 65_535


class Received(NamedTuple):
    """One message as received: data, host receive time in ns, and the sender, empty where the transport gives none."""

    data: bytes
    receive_time_ns: int
    sender: Any


class Inbox:
    """Messages waiting for one device's thread, at most most_bytes; if it is full, the oldest are dropped and counted.

    over: no more will come.
    """

    def __init__(self, most_bytes: int) -> None:
        self.over = False
        self._most_bytes = most_bytes
        self._news = threading.Condition(threading.Lock())
        self._waiting: deque[Received] = deque()
        self._bytes = self._lost = 0

    def put(self, data: bytes, sender: Any = None) -> None:
        """Add a message with its receive time."""
        receive_time_ns = host_time.now_ns()
        with self._news:
            self._waiting.append(Received(data, receive_time_ns, sender))
            self._bytes += len(data)
            while self._bytes > self._most_bytes:
                self._bytes -= len(self._waiting.popleft().data)
                self._lost += 1
            self._news.notify()

    def end(self) -> None:
        """Mark the end: no more messages will come. Wakes a waiting `take`."""
        with self._news:
            self.over = True
            self._news.notify()

    def take(self, timeout_s: float) -> list[Received]:
        """Return the waiting messages, oldest first, up to some 64 kB; [] if there are none.

        Waits at most timeout_s for the first, unless the inbox is over.
        """
        with self._news:
            self._news.wait_for(lambda: self._waiting or self.over, timeout_s)
            taken, size = list[Received](), 0
            while self._waiting and size < _AT_ONCE_BYTES:
                taken.append(self._waiting.popleft())
                size += len(taken[-1].data)
            self._bytes -= size
            return taken

    def lost(self) -> int:
        """Return the number of messages dropped for lack of room since the last call."""
        with self._news:
            lost, self._lost = self._lost, 0
            return lost


def joined(heard: list[Received]) -> Chunk:
    """Join received messages to one chunk of bytes, received when the last one was; empty, received now, if none."""
    return Chunk(b"".join(one.data for one in heard), heard[-1].receive_time_ns if heard else host_time.now_ns())
