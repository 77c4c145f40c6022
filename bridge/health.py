"""What a process says of itself over HTTP: /metrics for Prometheus, /healthz (it lives), /readyz (it can do its work).

The only file with prometheus_client. Nothing is counted here: families are read when somebody asks.
"""

import logging
import socket
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Self

from prometheus_client import CollectorRegistry, ProcessCollector, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4

from bridge import os_words
from bridge.bus.routers import Routers

_log = logging.getLogger(__name__)

#: who does not ask or listen for so long is let go; so many are answered at a time
PATIENCE_S, AT_ONCE = 5.0, 8


@dataclass(frozen=True, slots=True)
class Family:
    """One metric: its name after `truerate_`, and a value for each set of label values. A counter only grows."""

    name: str
    help: str
    labels: Sequence[str] = ()
    values: Mapping[Any, float] = field(default_factory=dict)
    counter: bool = False


def certificate(routers: Routers) -> Iterator[Family]:
    """When that of a program ends, where it has one: read anew, for it may have been renewed."""
    ends = routers.until()
    if ends is not None:
        help_ = "When this program's certificate ends, or one above it."
        yield Family("certificate_ends_timestamp_seconds", help_, (), {(): ends.timestamp()})


@dataclass(frozen=True, slots=True)
class Asked:
    """What is answered: each is called on a thread of the server. `sick` and `unready` say why, empty when all is well."""

    families: Callable[[], Iterable[Family]]
    sick: Callable[[], Sequence[str]]
    unready: Callable[[], Sequence[str]]


class Health:
    """Answers on (host, port) while it is open; raises OSError where it cannot listen."""

    def __init__(self, address: tuple[str, int], asked: Asked) -> None:
        try:
            self._server = _Server(address, asked)
        except OSError as error:
            where = f"address {address[0]}:{address[1]}"
            raise OSError(f"{where}: {os_words.why(error)}; choose another `health` in the ward's file") from error
        self.port = int(self._server.server_address[1])
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.2,), name="health", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False

    def __init__(self, address: tuple[str, int], asked: Asked) -> None:
        self.address_family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        self.asked = asked
        self.registry = CollectorRegistry()
        self.registry.register(_Collector(asked))
        ProcessCollector(registry=self.registry)
        self._room = threading.BoundedSemaphore(AT_ONCE)
        super().__init__(address, _Handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        if not self._room.acquire(blocking=False):
            self.shutdown_request(request)
            return
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._room.release()

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ARG002 - as the base has it
        _log.debug("health: a request of %s failed", client_address, exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = PATIENCE_S
    server_version, sys_version = "truerate", ""

    def do_GET(self) -> None:
        path = self.path.partition("?")[0]
        if path == "/metrics":
            self._answer(200, generate_latest(self.server.registry), CONTENT_TYPE_PLAIN_0_0_4)
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


class _Collector:
    def __init__(self, asked: Asked) -> None:
        self._asked = asked

    def collect(self) -> Iterator[Metric]:
        for family in self._asked.families():
            kind = CounterMetricFamily if family.counter else GaugeMetricFamily
            metric = kind("truerate_" + family.name, family.help, labels=family.labels)
            for labels, value in family.values.items():
                metric.add_metric(labels, value)
            yield metric
