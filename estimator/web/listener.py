"""HTTP server on uvicorn, with limits on connections and their duration. Only this file uses uvicorn."""

import asyncio
import contextlib
import logging
import ssl
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import h11
import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol

from bridge.config.ward_file import stamp_of
from bridge.runtime import os_errors
from bridge.runtime.open_files import make_room
from bridge.wire.refusal import Tally
from estimator.web.client_address import neighbourhood

log = logging.getLogger(__name__)

#: longest time for a whole request, or for reading an answer, s; slower clients are disconnected
WHOLE_S = 15.0
#: most connections, and most from one address; twice the viewers, since a page opens more than its websocket
CONNECTIONS, OF_ONE_ADDRESS = 1000, 250
#: open files needed for anything else: the bus, the store, Python's own
_OTHER_FILES = 200
#: what asyncio logs again and again while something is still written to a client that has left
_LEFT = "socket.send() raised exception."
#: addresses of a reverse proxy on this machine
_PROXIES = ("127.0.0.1", "::1")
_FULL = b"Too many connections are open; try again in a while.\n"
_REFUSAL = (
    b"HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nRetry-After: 15\r\n"
    b"Content-Type: text/plain; charset=utf-8\r\nContent-Length: %d\r\n\r\n%b" % (len(_FULL), _FULL)
)


class _Bounded(H11Protocol):
    """uvicorn's protocol with limits on connections and on waiting time; a subclass sets the limits."""

    #: most connections; addresses of proxies, which have no limit of their own; refusals by reason
    most: ClassVar[int]
    proxies: ClassVar[tuple[str, ...]]
    refused: ClassVar[Tally]
    _waits: asyncio.TimerHandle | None = None
    _served = False

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override] # as uvicorn's
        super().connection_made(transport)
        if words := self._too_many():
            if self.refused.add("too many") == 1:
                log.warning("a connection is refused: %s (further refusals are counted, not logged)", words)
            transport.write(_REFUSAL)
            transport.close()
        self._look()

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        self._look()

    def on_response_complete(self) -> None:
        self._served = True
        super().on_response_complete()
        self._look()

    def timeout_keep_alive_handler(self) -> None:
        super().timeout_keep_alive_handler()
        self._look()

    def pause_writing(self) -> None:
        super().pause_writing()
        self._look()

    def resume_writing(self) -> None:
        super().resume_writing()
        self._look()

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self._stop()

    def _look(self) -> None:
        """Start or stop the timer, which runs while we wait for the client; between requests uvicorn's limit applies."""
        if self.transport.get_protocol() is not self or not self._client_is_waited_for():
            self._stop()
        elif self._waits is None:
            self._waits = self.loop.call_later(WHOLE_S, self._let_go)

    def _client_is_waited_for(self) -> bool:
        if self.transport.is_closing() or self.flow.write_paused or self.conn.their_state is h11.SEND_BODY:
            return True
        return self.conn.their_state is h11.IDLE and (not self._served or bool(self.conn.trailing_data[0]))

    def _stop(self) -> None:
        if self._waits is not None:
            self._waits.cancel()
            self._waits = None

    def _let_go(self) -> None:
        self.refused.add("too slow")
        self.transport.abort()

    def _too_many(self) -> str:
        """Why a connection is refused, in words; empty when there is room. A proxy limits its own clients."""
        if len(self.connections) > self.most:
            return f"{self.most} connections are open"
        address = self.client[0] if self.client else ""
        if address in self.proxies:
            return ""
        near, there = neighbourhood(address), 0
        for one in self.connections:
            client: Any = getattr(one, "client", None)
            there += client is not None and neighbourhood(client[0]) == near
        return f"{OF_ONE_ADDRESS} connections are open from {near}" if there > OF_ONE_ADDRESS else ""


class Listener(uvicorn.Server):
    """HTTP server for an ASGI application, with limits on connections; stops when `should_exit` is set.

    Signal handlers stay unchanged, since uvicorn's would end the process too early.
    """

    def __init__(
        self, app: ASGIApp, *, behind_proxy: bool, connections: int, certificate: str = "", key: str = ""
    ) -> None:
        #: refused or aborted connections, by reason
        self.refused = tally = Tally()
        logging.getLogger("asyncio").addFilter(_is_news)

        class Ours(_Bounded):
            most, proxies, refused = connections, _PROXIES if behind_proxy else (), tally

        super().__init__(
            uvicorn.Config(
                app,
                http=Ours,
                ws="websockets-sansio",
                ws_max_size=8192,
                ws_per_message_deflate=False,  # a frame encoded once would be compressed again for each viewer
                proxy_headers=behind_proxy,
                forwarded_allow_ips=list(_PROXIES),
                ssl_certfile=certificate or None,
                ssl_keyfile=key or None,
                server_header=False,
                access_log=False,
                log_config=None,
                log_level="warning",
                timeout_graceful_shutdown=2,
            )
        )

        self._certified = stamp_of(Path(certificate))

    def renew(self) -> None:
        """Load the TLS certificate and key again for new connections, if the certificate's file has changed.

        If the new files are faulty, an error is logged, and the old certificate stays in use.
        """
        file, key, context = self.config.ssl_certfile, self.config.ssl_keyfile, self.config.ssl
        if context is None or not file or (stamp := stamp_of(Path(file))) == self._certified:
            return
        self._certified = stamp
        try:
            ssl.create_default_context().load_cert_chain(file, key)  # a faulty file leaves the one in use
            context.load_cert_chain(file, key)
        except OSError as error:
            log.error("the certificate %s has changed and cannot be used: %s", file, os_errors.why(error))
        else:
            log.info("the changed certificate %s is in use", file)

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Context manager without effect; it overrides uvicorn's, which would replace the signal handlers."""
        yield


def _is_news(record: logging.LogRecord) -> bool:
    return record.msg != _LEFT


def room() -> int:
    """Return how many connections the limit of open files allows, at least 1; increases that limit if possible."""
    return max(1, make_room(CONNECTIONS + _OTHER_FILES) - _OTHER_FILES)
