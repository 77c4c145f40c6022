"""Bounded inbox of one device: passes received messages from a receiving thread to the device's thread."""

import threading
from collections import deque
from typing import Any, NamedTuple

from bridge.transport import host_time
from bridge.transport.transport import Chunk

_AT_ONCE_BYTES = 65_535


class Received(NamedTuple):
    """Message as received: data, receive time and sender.

    receive_time_ns: by `host_time.now_ns`, ns since the Unix epoch. sender: None where the transport gives none.
    """

    data: bytes
    receive_time_ns: int
    sender: Any


class Inbox:
    """Queue of messages for one device's thread, of at most most_bytes bytes.

    If the queue is full, the oldest messages are dropped and counted. over: True after the last message was put.
    """

    def __init__(self, most_bytes: int) -> None:
        self.over = False
        self._most_bytes = most_bytes
        self._news = threading.Condition(threading.Lock())
        self._waiting: deque[Received] = deque()
        self._bytes = self._lost = 0

    def put(self, data: bytes, sender: Any = None) -> None:
        """Add a message, with the present time as its receive time. sender: its origin, if known."""
        receive_time_ns = host_time.now_ns()
        with self._news:
            self._waiting.append(Received(data, receive_time_ns, sender))
            self._bytes += len(data)
            while self._bytes > self._most_bytes:
                self._bytes -= len(self._waiting.popleft().data)
                self._lost += 1
            self._news.notify()

    def end(self) -> None:
        """Mark the inbox as over: no more messages will come. Wakes a waiting `take`."""
        with self._news:
            self.over = True
            self._news.notify()

    def take(self, timeout_s: float) -> list[Received]:
        """Return the waiting messages, oldest first, up to about 64 kB; empty if there are none.

        Waits at most timeout_s for the first message, unless the inbox is over.
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
    """Join received messages to one chunk of bytes, with the receive time of the last message.

    Without messages, the chunk is empty and its time is now.
    """
    return Chunk(b"".join(one.data for one in heard), heard[-1].receive_time_ns if heard else host_time.now_ns())
