"""The health server as Prometheus and a person ask it, over a real socket."""

import http.client
import socket
from collections.abc import Iterator
from contextlib import closing, suppress
from importlib.metadata import version

import pytest

from bridge.config.schema import listening
from bridge.runtime.health_server import AT_ONCE, HealthServer, HealthSource, MetricFamily
from tests.bridge.asking import get


class Told:
    """What is answered, to be set by hand."""

    def __init__(self) -> None:
        self.families: list[MetricFamily] = []
        self.sick: list[str] = []
        self.unready: list[str] = []


@pytest.fixture
def told() -> Told:
    return Told()


@pytest.fixture
def health(told: Told) -> Iterator[HealthServer]:
    asked = HealthSource(lambda: told.families, lambda: told.sick, lambda: told.unready)
    with HealthServer(("127.0.0.1", 0), asked) as server:
        yield server


def test_metrics(health: HealthServer, told: Told) -> None:
    told.families = [
        MetricFamily("rate_hz", "Samples a second.", ("device",), {("chest",): 104.0, ("wrist",): 52.0}),
        MetricFamily("samples_in", "Samples.", ("device",), {("chest",): 7}, counter=True),
    ]
    code, said = get(health.port, "/metrics")
    assert code == 200
    assert '# TYPE truerate_rate_hz gauge\ntruerate_rate_hz{device="chest"} 104.0' in said
    assert 'truerate_samples_in_total{device="chest"} 7.0' in said
    assert f'truerate_build_info{{version="{version("truerate")}"}} 1.0' in said, (
        "which is asked while some are upgraded"
    )
    assert "process_resident_memory_bytes" in said
    told.families = []
    assert "truerate_rate_hz" not in get(health.port, "/metrics")[1], "what is gone is not shown any more"


def test_alive_and_ready(health: HealthServer, told: Told) -> None:
    assert get(health.port, "/healthz") == (200, "ok\n")
    assert get(health.port, "/readyz?verbose") == (200, "ok\n")
    told.sick, told.unready = ["stuck"], ["no router", "no device"]
    assert get(health.port, "/healthz") == (503, "stuck\n")
    assert get(health.port, "/readyz") == (503, "no router\nno device\n")
    assert get(health.port, "/")[0] == 404
    assert get(health.port, "/../etc/passwd")[0] == 404


@pytest.mark.parametrize("said", [b"", b"GET /healthz HTTP/1.1\r\nX: ", b"GET /metrics HTTP/1.1\r\n\r\n"])
def test_those_who_only_wait_or_do_not_listen_shut_nobody_out(health: HealthServer, told: Told, said: bytes) -> None:
    long = {(f"{n:04}" * 100,): 1.0 for n in range(10_000)}  # more than append the us and them can hold
    told.families = [MetricFamily("rate_hz", "Samples a second.", ("device",), long)]
    idle = [socket.create_connection(("127.0.0.1", health.port)) for _ in range(2 * AT_ONCE + 4)]
    for one in idle:
        with suppress(OSError):  # it has made room already
            one.sendall(said)
    for path in ("/healthz", "/readyz"):
        assert get(health.port, path) == (200, "ok\n")
    for one in idle:
        one.close()


def test_a_port_in_use_is_said(health: HealthServer) -> None:
    with pytest.raises(OSError, match=f"address 127.0.0.1:{health.port}: in use by another program; choose another"):
        HealthServer(("127.0.0.1", health.port), HealthSource(list, list, list))


@pytest.mark.parametrize("address", ["127.0.0.1", "127.0.0.1:", ":9464", "a:b", "a:0", "a:65536", "a\n:1"])
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(ValueError, match="write HOST:PORT"):
        listening(address)


def test_an_address() -> None:
    assert listening("127.0.0.1:9464") == ("127.0.0.1", 9464)
    assert listening("[::1]:9464") == ("::1", 9464)


@pytest.mark.parametrize(
    ("host", "code"),
    [
        ("evil.example", 400),
        ("evil.example:9464", 400),
        ("127.0.0.1@evil.example", 400),
        ("localhost:1", 200),
        ("[::1]:9464", 200),
        (socket.gethostname(), 200),
    ],
)
def test_a_foreign_name_that_leads_here_is_told_nothing(health: HealthServer, host: str, code: int) -> None:
    for path in ("/metrics", "/readyz"):
        with closing(http.client.HTTPConnection("127.0.0.1", health.port, timeout=60)) as connection:
            connection.request("GET", path, headers={"Host": host})
            assert connection.getresponse().status == code
