"""Why no router answers: what the network itself says, in words with the address."""

import socket
from collections.abc import Iterator

import pytest

from bridge.bus.router_watch import why_unreachable
from estimator.demo.ward import free_port


@pytest.fixture
def silent() -> Iterator[socket.socket]:
    """Something listens and says nothing."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server


def test_the_network_is_asked(silent: socket.socket) -> None:
    assert why_unreachable(f"tcp/127.0.0.1:{free_port()}") == "no program listens there"
    assert why_unreachable(f"tls/127.0.0.1:{free_port()}#iface=lo") == "no program listens there"
    assert why_unreachable("tcp/nobody.invalid:7447") == "the name nobody.invalid is unknown"
    assert why_unreachable(f"tcp/127.0.0.1:{silent.getsockname()[1]}") == ""
    assert why_unreachable("unixsock-stream//tmp/x") == why_unreachable("udp/127.0.0.1:1") == ""
