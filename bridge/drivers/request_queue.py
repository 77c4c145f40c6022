"""Queue of requests to a device: one open at a time, repeated until answered. Pure: time is an argument."""

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from bridge.drivers.driver import Notice


class _Request(NamedTuple):
    key: int | str
    commands: tuple[bytes, ...]


class RequestQueue:
    """Requests to a device, sent one at a time and repeated until answered.

    again_s: seconds to wait for an answer before sending again.
    times: sends before a request is given up.
    give_up: called when the open request was sent `times` times unanswered; it empties the queue or closes the request,
    and returns what to tell people.
    spacing_s: minimum seconds between two commands.
    """

    def __init__(self, again_s: float, times: int, give_up: Callable[[], list[Notice]], spacing_s: float = 0.0) -> None:
        self._again_ns, self._spacing_ns = round(again_s * 1e9), round(spacing_s * 1e9)
        self._times, self._give_up = times, give_up
        self._now_ns = self._sent_ns = 0
        self.clear()

    def clear(self) -> None:
        """Discard all requests and all commands that wait to be sent."""
        self._open: deque[_Request] = deque()
        self._commands: deque[bytes] = deque()
        self._sent = self._asked_ns = 0

    @property
    def key(self) -> int | str | None:
        """Key of the open request, waiting for its answer or next to be sent; None if all are answered."""
        return self._open[0].key if self._open else None

    @property
    def sending(self) -> bool:
        """True if commands wait to be fetched by `command`."""
        return bool(self._commands)

    def add(self, key: int | str, *commands: bytes) -> None:
        """Queue a request of one or more commands under a key, unless a request of the same key already waits."""
        if all(request.key != key for request in list(self._open)[1 if self._sent else 0 :]):
            self._open.append(_Request(key, commands))

    def tell(self, *commands: bytes) -> None:
        """Queue commands that the device does not answer."""
        self._commands += commands

    def answered(self) -> None:
        """Close the open request, because its answer came; the next one follows."""
        self._open.popleft()
        self._sent = 0

    def passed(self, now_ns: int) -> list[Notice]:
        """Let time pass until now_ns (host time): send the next request, repeat the open one, or give it up."""
        self._now_ns = now_ns
        if not self._open or self._commands or (self._sent and 0 <= now_ns - self._asked_ns < self._again_ns):
            return []
        if self._sent == self._times:
            return self._give_up()
        self._sent += 1
        self._asked_ns = now_ns
        self._commands += self._open[0].commands
        return []

    def command(self) -> bytes:
        """Return the next command to send; empty if none, or if spacing_s since the last command has not passed."""
        if not self._commands or (self._sent_ns and self._now_ns - self._sent_ns < self._spacing_ns):
            return b""
        self._sent_ns = self._now_ns
        return self._commands.popleft()
