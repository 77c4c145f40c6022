"""Embedded zenoh router: runs inside this process, for a ward on one machine and for tests."""

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

#: zenoh's receive threads forward messages and also close sessions. With zenoh's default of two threads, one reader that is cut
#: off stops all traffic until TCP gives up its connection, 8 s and more: both threads wait for room to send to that reader, and
#: no thread is left to close it (https://github.com/eclipse-zenoh/zenoh/issues/1876). More threads than senders do no harm.
THREADS = "(rx: (worker_threads: 32))"
_RUNTIME = "ZENOH_RUNTIME"


class Router:
    """Embedded zenoh router. It routes messages from construction until `close`.

    listen: endpoints to listen on, for example `tcp/127.0.0.1:7447`.
    shed: key patterns on which a slow reader loses messages instead of delaying all other readers; meant for display
    data.
    A subscription with history fetches the lost messages from the publisher's cache.
    settings: complete zenoh settings, used instead of `shed`.
    Raises BusError if `listen` is empty or the router cannot listen on an endpoint.
    """

    def __init__(
        self, listen: Sequence[str], *, shed: Sequence[str] = (), settings: zenoh_settings.Settings | None = None
    ) -> None:
        if not listen:
            raise BusError("a router needs an endpoint to listen on, for example tcp/127.0.0.1:7447")
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
        """Start a router from a zenohd configuration file (JSON5).

        Raises BusError if the file is invalid or an endpoint cannot be used.
        """
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
    """Set zenoh's thread count in the environment while the first session opens.

    zenoh reads the variable once per process. The variable is removed again, so that child processes do not inherit it.
    """
    ours = _RUNTIME not in os.environ
    if ours:
        os.environ[_RUNTIME] = THREADS
    try:
        yield
    finally:
        if ours:
            os.environ.pop(_RUNTIME, None)


def endpoints_of(said: Sequence[str] | dict[str, Sequence[str]]) -> tuple[str, ...]:
    """Return a router's endpoints from zenoh's setting `endpoints`: a list, or a dict with one list per zenoh mode.

    said: value of the setting. Of a dict, the list of the mode `router` is returned.
    """
    return tuple(said.get("router", ())) if isinstance(said, dict) else tuple(said)


def _advice(said: str) -> str:
    """Return advice for a failed listen, from the OS error number in zenoh's message."""
    causes = {
        errno.EADDRINUSE: "another program listens there already: stop it, or choose another port",
        errno.EADDRNOTAVAIL: "this machine has no such address: use one of its own, or 0.0.0.0 for all of them",
        errno.EACCES: "a port below 1024 needs permission: choose a higher one",
    }
    for number, advice in causes.items():
        if f"(os error {number})" in said:
            return advice
    return "use an address of this machine, and check that no other router runs there"
