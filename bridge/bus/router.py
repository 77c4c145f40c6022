"""zenoh's own router inside this process, for a ward on one machine and for tests."""

import atexit
from collections.abc import Sequence
from typing import Self

from bridge.bus import zenoh_settings
from bridge.bus.contract import BusError
from bridge.bus.zenoh_bus import close_session, open_session


class Router:
    """Routes from construction to close().

    listen: endpoints, for example `tcp/127.0.0.1:7447`. shed: patterns on which a reader that cannot keep up loses
    messages (repaired from the publisher's cache, where it asked for history) instead of slowing everybody; for keys
    that viewers read. Raises BusError when it cannot listen.
    """

    def __init__(self, listen: Sequence[str], *, shed: Sequence[str] = ()) -> None:
        if not listen:
            raise BusError("a router must listen somewhere, for example on tcp/127.0.0.1:7447")
        self.listen = tuple(listen)
        complaint = f"cannot listen on {', '.join(listen)}; is another router running there?"
        self._session = open_session(zenoh_settings.router(listen, shed), complaint)
        self._closed = False
        atexit.register(self.close)

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
