"""A TCP line between a part of the ward and its router, which can be held (nothing passes, nothing is closed) or cut."""

import contextlib
import select
import socket
import threading
from collections.abc import Sequence
from typing import Self

_CHUNK = 65536
_TURN_S = 0.02


class Line:
    """Listens on loopback and passes on to `port`; a thread of its own."""

    def __init__(self, port: int) -> None:
        self._to = port
        self._pairs: dict[socket.socket, socket.socket] = {}
        self._held, self._cut, self._over = threading.Event(), threading.Event(), threading.Event()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._thread = threading.Thread(target=self._run, name=f"line to {port}", daemon=True)
        self._thread.start()

    def hold(self) -> None:
        """A black hole: bytes stay where they are until `mend`."""
        self._held.set()

    def cut(self) -> None:
        """A cable pulled: every connection is reset, and none is taken until `mend`."""
        self._cut.set()

    def mend(self) -> None:
        """As it was."""
        self._held.clear()
        self._cut.clear()

    def close(self) -> None:
        """End it with all that went through it."""
        self._over.set()
        self._thread.join()
        self._drop()
        self._listener.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _stands(self) -> bool:
        return self._held.is_set() or self._cut.is_set()

    def _run(self) -> None:
        while not self._over.is_set():
            if self._cut.is_set():
                self._drop()
            if self._stands():
                self._over.wait(_TURN_S)
                continue
            ready, _, _ = select.select([self._listener, *self._pairs], [], [], _TURN_S)
            for end in [] if self._stands() else ready:
                if end is self._listener:
                    self._take()
                elif end in self._pairs:
                    self._pass_on(end)

    def _take(self) -> None:
        near, _ = self._listener.accept()
        try:
            far = socket.create_connection(("127.0.0.1", self._to), 1.0)
        except OSError:
            near.close()  # the router is not there
            return
        for end in (near, far):
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            end.settimeout(2.0)
        self._pairs[near], self._pairs[far] = far, near

    def _pass_on(self, end: socket.socket) -> None:
        try:
            data = end.recv(_CHUNK)
            if data:
                self._pairs[end].sendall(data)
                return
        except OSError:
            pass  # either side went away
        self._end(end)

    def _end(self, end: socket.socket) -> None:
        for one in (end, self._pairs.pop(end)):
            self._pairs.pop(one, None)
            with contextlib.suppress(OSError):
                one.close()

    def _drop(self) -> None:
        while self._pairs:
            self._end(next(iter(self._pairs)))


class Lines:
    """All of a part's lines, one to each router: what is done is done to all."""

    def __init__(self, ports: Sequence[int]) -> None:
        self._lines = [Line(port) for port in ports]
        self.ports = [line.port for line in self._lines]

    def hold(self) -> None:
        """See Line."""
        for line in self._lines:
            line.hold()

    def cut(self) -> None:
        """See Line."""
        for line in self._lines:
            line.cut()

    def mend(self) -> None:
        """See Line."""
        for line in self._lines:
            line.mend()

    def close(self) -> None:
        """See Line."""
        for line in self._lines:
            line.close()
