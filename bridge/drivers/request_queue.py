"""Requests to a device: one at a time, each sent again until it is answered. Pure: time is an argument."""

from collections import deque
from typing import NamedTuple


class _Request(NamedTuple):
    key: int | str
    commands: tuple[bytes, ...]


class RequestQueue:
    """A queue of requests. again_s: how long an answer is waited for; times: how often a request is sent before it is given up.

    spacing_s: what the device needs between two commands.
    """

    def __init__(self, again_s: float, times: int, spacing_s: float = 0.0) -> None:
        self._again_ns, self._spacing_ns = round(again_s * 1e9), round(spacing_s * 1e9)
        self._times = times
        self._now_ns = self._sent_ns = 0
        self.clear()

    def clear(self) -> None:
        """Forget all that is open."""
        self._open: deque[_Request] = deque()
        self._commands: deque[bytes] = deque()
        self._sent = self._asked_ns = 0

    @property
    def key(self) -> int | str | None:
        """Of the request whose answer is waited for, or that is to be sent next; None: all are answered."""
        return self._open[0].key if self._open else None

    @property
    def sending(self) -> bool:
        """Commands wait to be sent."""
        return bool(self._commands)

    def add(self, key: int | str, *commands: bytes) -> None:
        """Make a request of some commands; one that is waiting under the same key is enough."""
        if all(request.key != key for request in list(self._open)[1 if self._sent else 0 :]):
            self._open.append(_Request(key, commands))

    def tell(self, *commands: bytes) -> None:
        """Send commands that are not answered."""
        self._commands += commands

    def answered(self) -> None:
        """The answer came: go on with the next."""
        self._open.popleft()
        self._sent = 0

    def passed(self, now_ns: int) -> bool:
        """Send what is due at now_ns. Whether the open request was sent often enough, and is given up."""
        self._now_ns = now_ns
        if not self._open or self._commands or (self._sent and 0 <= now_ns - self._asked_ns < self._again_ns):
            return False
        if self._sent == self._times:
            return True
        self._sent += 1
        self._asked_ns = now_ns
        self._commands += self._open[0].commands
        return False

    def command(self) -> bytes:
        """The next command to send; empty if none, or if the device has not had the time for the last one."""
        if not self._commands or (self._sent_ns and self._now_ns - self._sent_ns < self._spacing_ns):
            return b""
        self._sent_ns = self._now_ns
        return self._commands.popleft()
