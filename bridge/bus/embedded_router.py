"""zenoh's own router inside this process, for a ward on one machine and for tests."""

import atexit
import errno
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Self

from bridge.bus import zenoh_settings
from bridge.bus.contract import BusError
from bridge.bus.zenoh_session import close_session, open_session, read_settings

#: zenoh passes a message on from the thread that received it, and closes a session there, too. With its own two threads a reader
#: that is cut off stops all until the network gives its connection up, 8 s and more: both wait for room to tell it something, and
#: nobody is left to close it (https://github.com/eclipse-zenoh/zenoh/issues/1876). More than senders at a router do no harm.
THREADS = "(rx: (worker_threads: 32))"
_RUNTIME = "ZENOH_RUNTIME"


class Router:
    """Routes from construction to close().

    listen: endpoints, for example `tcp/127.0.0.1:7447`. shed: patterns on which a reader that cannot keep up loses
    messages (repaired from the publisher's cache, where it asked for history) instead of slowing everybody; for keys
    that viewers read. Raises BusError when it cannot listen.
    """

    def __init__(
        self, listen: Sequence[str], *, shed: Sequence[str] = (), settings: zenoh_settings.Settings | None = None
    ) -> None:
        if not listen:
            raise BusError("a router must listen somewhere, for example on tcp/127.0.0.1:7447")
        self.listen = tuple(listen)
        try:
            with _threads():
                self._session = open_session(
                    settings or zenoh_settings.router(listen, shed), f"cannot listen on {', '.join(listen)}"
                )
        except BusError as error:
            raise BusError(f"{error}; {_advice(str(error))}") from error.__cause__
        self._closed = False
        atexit.register(self.close)

    @classmethod
    def of_file(cls, path: Path) -> Self:
        """As a file for zenohd says, JSON5."""
        settings = read_settings(str(path))
        return cls(endpoints_of(settings["listen"]["endpoints"]), settings=settings)

    def close(self) -> None:
        """Stop routing and free the ports; a second close does nothing."""
        if not self._closed:
            self._closed = True
            atexit.unregister(self.close)
            close_session(self._session)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@contextmanager
def _threads() -> Iterator[None]:
    """Zenoh looks for it once, when the first session of a process is opened; processes that we start have their own."""
    ours = _RUNTIME not in os.environ
    if ours:
        os.environ[_RUNTIME] = THREADS
    try:
        yield
    finally:
        if ours:
            os.environ.pop(_RUNTIME, None)


def endpoints_of(said: Sequence[str] | dict[str, Sequence[str]]) -> tuple[str, ...]:
    """Zenoh takes one list, or one for each mode."""
    return tuple(said.get("router", ())) if isinstance(said, dict) else tuple(said)


def _advice(said: str) -> str:
    """What to do about an address that could not be listened on, from what zenoh said of it."""
    causes = {
        errno.EADDRINUSE: "something listens there already: is another router running?",
        errno.EADDRNOTAVAIL: "this machine has no such address: use one of its own, or 0.0.0.0 for all of them",
        errno.EACCES: "a port below 1024 needs permission: choose a higher one",
    }
    for number, advice in causes.items():
        if f"(os error {number})" in said:
            return advice
    return "is the address one of this machine's own, and no other router running there?"
