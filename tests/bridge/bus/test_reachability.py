"""Why no router answers: what the network itself says, in words with the address."""

import socket
from collections.abc import Iterator

import pytest

from bridge.bus.contract import BusError
from bridge.bus.reachability import why_unreachable
from bridge.bus.zenoh_bus import ZenohBus
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


def test_what_cannot_be_reached_is_said_with_its_address_and_without_zenohs_own_words(silent: socket.socket) -> None:
    gone, there = f"tcp/127.0.0.1:{free_port()}", f"tcp/127.0.0.1:{silent.getsockname()[1]}"
    with pytest.raises(BusError) as nothing:
        ZenohBus([gone], open_timeout_s=0.2)
    assert str(nothing.value) == (
        f"no router answered at {gone} within 0.2 s: no program listens there; "
        f"start one with `truerate router --listen {gone}`, or correct the address"
    )
    with pytest.raises(BusError) as either:
        ZenohBus([gone, there], open_timeout_s=0.2)
    assert f"{gone}: no program listens there; the program at {there} may ask for a certificate" in str(either.value)
    assert "Unable to connect" not in str(either.value)
