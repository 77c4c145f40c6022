"""Queue of requests to a device: one request at a time, repeated until the device answers. No I/O; time is an argument."""

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from bridge.drivers.driver import Notice


class _Request(NamedTuple):
    key: int | str
    commands: tuple[bytes, ...]


class RequestQueue:
    """Queue of requests to a device, sent one at a time and repeated until answered.

    again_s: seconds to wait for an answer before a request is repeated. times: number of times that a request is sent.
    give_up: called when a request stays unanswered; it empties the queue or closes the request, and returns notices for
    the user. spacing_s: shortest time between two commands, s.
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
        """Key of the current request, which waits for its answer or is sent next; None if all requests are answered."""
        return self._open[0].key if self._open else None

    @property
    def sending(self) -> bool:
        """True if commands wait to be fetched by `command`."""
        return bool(self._commands)

    def add(self, key: int | str, *commands: bytes) -> None:
        """Queue a request of one or more commands under a key, unless a request of the same key waits already."""
        if all(request.key != key for request in list(self._open)[1 if self._sent else 0 :]):
            self._open.append(_Request(key, commands))

    def tell(self, *commands: bytes) -> None:
        """Queue commands for which the device sends no answer; they are sent once."""
        self._commands += commands

    def answered(self) -> None:
        """Close the current request, because its answer arrived. The next request becomes the current one."""
        self._open.popleft()
        self._sent = 0

    def passed(self, now_ns: int) -> list[Notice]:
        """Advance the time to now_ns, ns since the Unix epoch: send the next request, repeat the current one, or give it up.

        Returns the notices of a request that is given up, else [].
        """
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
        """Return the bytes of the next command to send; b"" if none waits.

        Also returns b"" if less than spacing_s seconds have passed since the previous command.
        """
        if not self._commands or (self._sent_ns and self._now_ns - self._sent_ns < self._spacing_ns):
            return b""
        self._sent_ns = self._now_ns
        return self._commands.popleft()
