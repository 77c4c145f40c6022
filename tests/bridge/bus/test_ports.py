"""Which connections of a process are a session's: what hangs up for an estimator goes by it."""

import os
import socket
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from bridge.bus.router import Router
from bridge.bus.routers import Routers
from bridge.bus.zenoh_bus import ZenohBus
from tests.bridge.pki.guarded_ward import GuardedWard, free_port


def _connected_to(port: int) -> Iterator[int]:
    """Our end of each connection of this process to a port that was not taken up here."""
    for path in list(Path("/proc/self/fd").iterdir()):
        with suppress(OSError):
            if path.readlink().name.startswith("socket:"):
                with socket.socket(fileno=os.dup(int(path.name))) as one:
                    if one.family == socket.AF_UNIX:  # No port: one end of a pair, as asyncio keeps one.
                        continue
                    if one.getpeername()[1] == port and one.getsockname()[1] != port:
                        yield one.getsockname()[1]


def _each_has_its_own(routers: Routers, port: int) -> None:
    with ZenohBus(routers) as data, ZenohBus(routers) as control:
        assert len(data.ports) == len(control.ports) == 1
        assert data.ports | control.ports == set(_connected_to(port))


@pytest.mark.parametrize("endpoint", ["tcp/127.0.0.1:{port}", "tcp/[::1]:{port}", "tcp/127.0.0.1:{port}?rel=1"])
def test_over_tcp(endpoint: str) -> None:
    port = free_port()
    endpoint = endpoint.format(port=port)
    with Router([endpoint]):
        _each_has_its_own(Routers((endpoint,)), port)


def test_over_tls(tmp_path: Path) -> None:
    ward = GuardedWard(tmp_path / "pki")
    with ward.running():
        _each_has_its_own(ward.routers("estimator:e1"), int(ward.endpoint.rpartition(":")[2]))
