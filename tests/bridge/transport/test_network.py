"""Devices over TCP and UDP on loopback: what came is read, what goes wrong has its words."""

import socket
import threading
import time
from collections.abc import Iterator

import pytest

from bridge.transport import address, udp_listener
from bridge.transport.errors import DeviceLost, DeviceUnavailable
from bridge.transport.tcp_port import TcpPort
from bridge.transport.transport import Chunk, Transport
from bridge.transport.udp_port import OTHERS, OVERFLOW, UdpPort
from estimator.demo.ward import free_port

PATIENCE_S = 30.0


def read(port: Transport, n: int) -> bytes:
    data, end = b"", time.monotonic() + PATIENCE_S
    while len(data) < n:
        assert time.monotonic() < end, f"only {data!r} came"
        data += port.read(0.1).data
    return data


def ended(port: Transport) -> str:
    """How another thread's close ends a read that would wait for long."""
    threading.Timer(0.1, port.close).start()
    began = time.monotonic()
    with pytest.raises(DeviceLost) as lost:
        port.read(60.0)
    assert time.monotonic() - began < PATIENCE_S
    return str(lost.value)


@pytest.fixture
def server() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as made:
        made.settimeout(PATIENCE_S)
        yield made


def client(server: socket.socket) -> TcpPort:
    return TcpPort(f"127.0.0.1:{server.getsockname()[1]}", 0)


def test_tcp_carries_bytes_both_ways(server: socket.socket) -> None:
    port = client(server)
    port.open()
    device, _ = server.accept()
    with device:
        device.sendall(b"hello")
        before = time.time_ns()
        assert read(port, 5) == b"hello"
        port.write(b"who?")
        assert device.recv(10) == b"who?"
        assert before <= port.read(0.01).receive_time_ns <= time.time_ns()
        assert port.read(0.01).data == b""
        port.close()
        port.close()
        assert device.recv(10) == b""
    with pytest.raises(DeviceLost, match="closed"):
        port.read(0.1)


def test_what_came_before_a_tcp_device_went_is_not_lost(server: socket.socket) -> None:
    sent = bytes(range(256)) * 100
    port = client(server)
    port.open()
    device, _ = server.accept()
    with device:
        device.sendall(sent)
    for _ in range(3):  # what is sent to a device that has gone breaks the connection
        port.write(b"?")
        time.sleep(0.02)
    assert read(port, len(sent)) == sent
    with pytest.raises(DeviceLost, match=r"closed the connection|lost"):
        read(port, 1)
    port.close()


def test_a_tcp_device_that_takes_nothing_is_lost(server: socket.socket, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bridge.transport.tcp_port._WRITE_S", 0.1)
    port = client(server)
    port.open()
    with server.accept()[0], pytest.raises(DeviceLost, match="does not accept data sent"):
        port.write(bytes(1 << 25))
    port.close()


def test_a_tcp_device_that_cannot_be_reached_is_unavailable_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    nobody = free_port()
    with pytest.raises(DeviceUnavailable, match=f"tcp://127.0.0.1:{nobody} refused the connection: no program listens"):
        TcpPort(f"127.0.0.1:{nobody}", 0).open()
    assert address.state(f"tcp://127.0.0.1:{nobody}").startswith(f"tcp://127.0.0.1:{nobody} refused")
    for error, said in [
        (socket.gaierror(-2, "Name or service not known"), "The host name in tcp://wrist:8000 is unknown"),
        (TimeoutError("timed out"), "does not answer. Is the device on"),
        (OSError(113, "No route to host"), "is unreachable. Is the device on"),
    ]:

        def fail(*_: object, error: OSError = error) -> socket.socket:
            raise error

        monkeypatch.setattr(socket, "create_connection", fail)
        with pytest.raises(DeviceUnavailable, match=said):
            TcpPort("wrist:8000", 0).open()


class Sender:
    """A device at an address of its own, which loopback has many of."""

    def __init__(self, host: str, port: int) -> None:
        self._to = ("127.0.0.1", port)
        self.socket = socket.socket(type=socket.SOCK_DGRAM)
        self.socket.settimeout(PATIENCE_S)
        self.socket.bind((host, 0))

    def say(self, *data: bytes) -> None:
        for datagram in data:
            self.socket.sendto(datagram, self._to)


@pytest.fixture
def udp() -> int:
    return free_port()


@pytest.fixture
def senders(udp: int) -> Iterator[list[Sender]]:
    made = [Sender(f"127.0.0.{i}", udp) for i in (2, 3, 4)]
    yield made
    for sender in made:
        sender.socket.close()


def opened(text: str) -> UdpPort:
    port = UdpPort(text, 0)
    port.open()
    return port


def until(port: Transport, what: bytes) -> Chunk:
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        chunk = port.read(0.1)
        if chunk.data == what:
            return chunk
    raise AssertionError(f"{what!r} did not come")


def test_datagrams_come_in_one_piece_and_are_answered(udp: int, senders: list[Sender]) -> None:
    port = opened(f":{udp}")
    port.write(b"nobody knows yet")
    senders[0].say(b"one", b"", b"two")
    assert read(port, 6) == b"onetwo"
    port.write(b"who?")
    assert senders[0].socket.recv(10) == b"who?"
    assert port.read(0.01).data == b""
    assert ended(port) == f"{port.place} was closed."


def test_devices_on_one_port_are_told_apart(udp: int, senders: list[Sender]) -> None:
    ports = [opened(f"127.0.0.1:{udp}?from=127.0.0.{i}") for i in (2, 3)]
    for sender in senders:
        sender.say(sender.socket.getsockname()[0].encode())
    assert [read(port, 9) for port in ports] == [b"127.0.0.2", b"127.0.0.3"]
    ports[0].close()
    senders[1].say(b"still here")
    until(ports[1], b"still here")
    ports[1].close()
    assert not udp_listener._listeners
    again = opened(f"127.0.0.1:{udp}")
    again.close()


def test_two_devices_never_become_one(udp: int, senders: list[Sender], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bridge.transport.udp_port._FORGOTTEN_NS", 10**12)
    port = opened(f":{udp}")
    senders[0].say(b"first")
    until(port, b"first")
    senders[1].say(b"other")
    senders[0].say(b"second")
    until(port, b"second")
    assert port.faults.as_dict() == {OTHERS: 1}
    monkeypatch.setattr("bridge.transport.udp_port._FORGOTTEN_NS", 0)
    senders[1].say(b"my turn")
    until(port, b"my turn")
    port.close()


def test_datagrams_that_nobody_reads_are_bounded_and_counted(udp: int, senders: list[Sender]) -> None:
    port = opened(f":{udp}")
    end = time.monotonic() + PATIENCE_S
    while port.faults.as_dict().get(OVERFLOW, 0) < 10:
        assert time.monotonic() < end
        for _ in range(400):  # 20 MB
            senders[0].say(bytes(50_000))
        port.read(0.0)
    waiting = 0
    while data := port.read(0.1).data:
        waiting += len(data)
    port.close()
    assert waiting < 8 << 20  # 1 MB here, and what the system's own buffer holds


def test_a_udp_port_is_busy_in_words(udp: int) -> None:
    with socket.socket(type=socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", udp))
        with pytest.raises(DeviceUnavailable, match="is busy: another program"):
            opened(f"127.0.0.1:{udp}")
        assert address.state(f"udp://127.0.0.1:{udp}").startswith(f"udp://127.0.0.1:{udp} is busy: another program")
    assert address.state(f"udp://127.0.0.1:{udp}") == "free"
    first = opened(f":{udp}")
    with pytest.raises(DeviceUnavailable, match=r"already receives from anyone. .*\?from="):
        opened(f"0.0.0.0:{udp}")
    second = opened(f":{udp}?from=localhost")
    with pytest.raises(DeviceUnavailable, match=r"already receives from 127\.0\.0\.1"):
        opened(f":{udp}?from=127.0.0.1")
    first.close()
    second.close()
    with pytest.raises(DeviceUnavailable, match="has no address"):
        opened(f"192.0.2.1:{udp}")
