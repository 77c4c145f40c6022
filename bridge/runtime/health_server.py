"""HTTP server for /metrics (Prometheus), /healthz (is the process alive?) and /readyz (can the process do its work?).

The server stores no values: it collects the metrics at each request.
"""

import logging
import socket
import threading
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from ipaddress import ip_address
from typing import Any, Self
from urllib.parse import urlsplit

from bridge.runtime import os_errors

_log = logging.getLogger(__name__)

#: timeout of an idle connection; connections served at a time, the oldest of which is closed for a new one
PATIENCE_S, AT_ONCE = 5.0, 8
#: host names accepted in requests, beside addresses
_NAMES = {"localhost", socket.gethostname().lower(), socket.gethostname().partition(".")[0].lower()}


@dataclass(frozen=True, slots=True)
class MetricFamily:
    """Prometheus metric: name without the prefix `truerate_`, help text, and one value for each tuple of label values.

    labels: names of the labels. counter: True if the values only grow.
    """

    name: str
    help: str
    labels: Sequence[str] = ()
    values: Mapping[Any, float] = field(default_factory=dict)
    counter: bool = False


@dataclass(frozen=True, slots=True)
class HealthSource:
    """Callbacks that answer the health server's requests. The server calls them on its own threads.

    families: returns the metrics. sick: returns the faults due to which the process counts as not alive, as texts.
    unready: returns the faults that keep the process from doing its work, as texts. Without faults, both return [].
    """

    families: Callable[[], Iterable[MetricFamily]]
    sick: Callable[[], Sequence[str]]
    unready: Callable[[], Sequence[str]]


class HealthServer:
    """HTTP server of metrics and health on (host, port), which runs for the length of a `with` block.

    asked: callbacks that answer the requests. port: the port in use. Raises OSError if the address cannot be used.
    """

    def __init__(self, address: tuple[str, int], asked: HealthSource) -> None:
        try:
            self._server = _Server(address, asked)
        except OSError as error:
            where = f"address {address[0]}:{address[1]}"
            raise OSError(f"{where}: {os_errors.why(error)}; choose another `health` in the ward file") from error
        self.port = int(self._server.server_address[1])
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.2,), name="health", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


def own_host(host: str, names: Container[str]) -> bool:
    """Return True if an HTTP Host header is acceptable for this machine: any IP address, or one of its `names`.

    names: host names in lower case. Other names are refused, because a foreign web page may use such a name to reach
    this machine (DNS rebinding).
    """
    try:
        parts = urlsplit(f"//{host}")
        name, _ = parts.hostname or "", parts.port
    except ValueError:
        return False
    if parts.netloc != host or "@" in host:
        return False
    if name in names:
        return True
    try:
        ip_address(name)
    except ValueError:
        return False
    return True  # DNS rebinding needs a name


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False
    request_queue_size = 128

    def __init__(self, address: tuple[str, int], asked: HealthSource) -> None:
        self.address_family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        self.asked = asked
        self._guests, self._rendering = _Guests(), threading.Lock()
        super().__init__(address, _Handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        self._guests.come(request)
        super().process_request(request, client_address)

    def asks(self, request: socket.socket) -> None:
        """Mark a connection as having sent its request."""
        self._guests.ask(request)

    def rendered(self, request: socket.socket) -> tuple[bytes, str]:
        """Render all metrics; return body and content type. One at a time, so that probes get their turn."""
        from bridge.runtime.metrics import KIND, rendered  # noqa: PLC0415 - imported at the first request, for a fast start

        with self._rendering:
            return rendered(self.asked) if self._guests.is_here(request) else b"", KIND

    def shutdown_request(self, request: Any) -> None:
        self._guests.go(request)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ARG002 - as the base has it
        _log.debug("health: a request from %s failed", client_address, exc_info=True)


class _Guests:
    """Open connections, at most AT_ONCE. A new one replaces the oldest idle one, or else the oldest with a request."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: dict[int, socket.socket] = {}  # the oldest first
        self._asking: dict[int, socket.socket] = {}

    def come(self, guest: socket.socket) -> None:
        with self._lock:
            while len(self._waiting) + len(self._asking) >= AT_ONCE:
                oldest = self._waiting or self._asking
                with suppress(OSError):  # already closed by the client; otherwise its thread wakes and closes it
                    oldest.pop(next(iter(oldest))).shutdown(socket.SHUT_RDWR)
            self._waiting[id(guest)] = guest

    def ask(self, guest: socket.socket) -> None:
        with self._lock:
            if self._waiting.pop(id(guest), None) is not None:
                self._asking[id(guest)] = guest

    def is_here(self, guest: socket.socket) -> bool:
        with self._lock:
            return id(guest) in self._asking

    def go(self, guest: socket.socket) -> None:
        with self._lock:
            for there in (self._waiting, self._asking):
                there.pop(id(guest), None)


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = PATIENCE_S
    server_version, sys_version = "truerate", ""

    def do_GET(self) -> None:
        self.server.asks(self.connection)
        if not own_host(self.headers.get("Host", "localhost"), _NAMES):
            self._answer(400, b"ask by this machine's address or name\n", "text/plain; charset=utf-8")
            return
        path = self.path.partition("?")[0]
        if path == "/metrics":
            self._answer(200, *self.server.rendered(self.connection))
        elif path in ("/healthz", "/readyz"):
            why = self.server.asked.sick() if path == "/healthz" else self.server.asked.unready()
            self._answer(503 if why else 200, ("\n".join(why) or "ok").encode() + b"\n", "text/plain; charset=utf-8")
        else:
            self._answer(404, b"there are /metrics, /healthz and /readyz\n", "text/plain; charset=utf-8")

    do_HEAD = do_GET  # noqa: N815 - as the base has it

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - as the base has it
        _log.debug("health: " + format, *args)

    def _answer(self, code: int, body: bytes, kind: str) -> None:
        self.send_response(code)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Connection", "close")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)
        self.close_connection = True
