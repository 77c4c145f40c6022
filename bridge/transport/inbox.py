"""Bounded queue of one device's received messages, from the receiving thread to the thread that reads the device."""

import threading
from collections import deque
from typing import Any, NamedTuple

from bridge.transport import host_time
from bridge.transport.transport import Chunk

_AT_ONCE_BYTES = 65_535


class Received(NamedTuple):
    """Message received from a device, such as a datagram: data, receive time and sender.

    receive_time_ns: ns since the Unix epoch, by `host_time.now_ns`. sender: address of the sender; None if unknown.
    """

    data: bytes
    receive_time_ns: int
    sender: Any


class Inbox:
    """Queue of the messages received from one device; a full queue drops its oldest messages and counts them.

    most_bytes: largest number of bytes in the queue. over: True after `end`, when no more messages are added.
    """

    def __init__(self, most_bytes: int) -> None:
        self.over = False
        self._most_bytes = most_bytes
        self._news = threading.Condition(threading.Lock())
        self._waiting: deque[Received] = deque()
        self._bytes = self._lost = 0

    def put(self, data: bytes, sender: Any = None) -> None:
        """Add a message; the present time becomes its receive time. sender: address of the sender, if known."""
        receive_time_ns = host_time.now_ns()
        with self._news:
            self._waiting.append(Received(data, receive_time_ns, sender))
            self._bytes += len(data)
            while self._bytes > self._most_bytes:
                self._bytes -= len(self._waiting.popleft().data)
                self._lost += 1
            self._news.notify()

    def end(self) -> None:
        """Set `over`, because no more messages will come; a waiting `take` returns."""
        with self._news:
            self.over = True
            self._news.notify()

    def take(self, timeout_s: float) -> list[Received]:
        """Remove and return waiting messages, oldest first, up to about 64 kB; [] if there are none.

        If the queue is empty, waits at most timeout_s seconds for a message; does not wait if `over` is True.
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
        """Return the number of messages that the full queue has dropped since the previous call."""
        with self._news:
            lost, self._lost = self._lost, 0
            return lost


def joined(heard: list[Received]) -> Chunk:
    """Join received messages to one chunk of bytes, with the receive time of the last message.

    Without messages, the chunk has no bytes, and its receive time is the present time.
    """
    return Chunk(b"".join(one.data for one in heard), heard[-1].receive_time_ns if heard else host_time.now_ns())
