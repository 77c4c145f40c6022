"""A ward of devices on the network: published whole, and opened again when a connection broke."""

import socket
import threading
import time
from collections.abc import Iterator

import pytest

from bridge.config.schema import Bridge, Device
from bridge.drivers.byte_stream import StreamOptions
from bridge.ingest.pump import Pump
from bridge.sim.virtual_device import VirtualDevice, demo_device
from bridge.transport import udp_listener
from estimator.demo.ward import free_port
from tests.bridge.ingest.published.hearing import Listener, unbroken
from tests.memory_bus import MemoryBroker, MemoryBus


class Living:
    """A device that lives in real time and sends where it is told to, while it is told to."""

    def __init__(self, device: VirtualDevice) -> None:
        self.device = device
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> "Living":
        self._thread.start()
        return self

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        begun = time.monotonic()
        while not self._stop.wait(0.01):
            self.exchange(self.device.advance(time.monotonic() - begun))

    def exchange(self, data: bytes) -> None:
        raise NotImplementedError


class TcpDevice(Living):
    """A server that takes one client after another."""

    def __init__(self, device: VirtualDevice) -> None:
        super().__init__(device)
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.setblocking(False)
        self.place = f"tcp://127.0.0.1:{self._server.getsockname()[1]}"
        self.client: socket.socket | None = None

    def exchange(self, data: bytes) -> None:
        try:
            if self.client is None:
                self.client, _ = self._server.accept()
                self.client.setblocking(False)
                return
            self.client.sendall(data)
            if asked := self.client.recv(1000):
                self.device.receive(asked)
            else:
                self.drop()
        except BlockingIOError:
            return
        except OSError:
            self.drop()

    def drop(self) -> None:
        if self.client is not None:
            self.client.close()
            self.client = None

    def stop(self) -> None:
        super().stop()
        self.drop()
        self._server.close()


class UdpDevice(Living):
    """Sends datagrams from a host of its own."""

    def __init__(self, device: VirtualDevice, host: str, port: int) -> None:
        super().__init__(device)
        self.place = f"udp://127.0.0.1:{port}?from={host}"
        self._to = ("127.0.0.1", port)
        self._socket = socket.socket(type=socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind((host, 0))

    def exchange(self, data: bytes) -> None:
        try:
            if data:
                self._socket.sendto(data, self._to)
            self.device.receive(self._socket.recv(1000))
        except OSError:
            return

    def stop(self) -> None:
        super().stop()
        self._socket.close()


@pytest.fixture
def devices() -> Iterator[dict[str, TcpDevice | UdpDevice]]:
    port = free_port()
    made: dict[str, TcpDevice | UdpDevice] = {
        "t1": TcpDevice(demo_device("t1", 1)),
        "t2": TcpDevice(demo_device("t2", 2)),
        "u1": UdpDevice(demo_device("u1", 3), "127.0.0.2", port),
        "u2": UdpDevice(demo_device("u2", 4), "127.0.0.3", port),
    }
    for device in made.values():
        device.start()
    yield made
    for device in made.values():
        device.stop()


def ward(devices: dict[str, TcpDevice | UdpDevice], bus: MemoryBus) -> Pump:
    return Pump(
        "w",
        Bridge(
            id="b1",
            batch_ms=20,
            devices=tuple(Device(name, "native", StreamOptions(port=d.place)) for name, d in devices.items()),
        ),
        bus,
    )


def test_devices_on_the_network_are_published_whole(devices: dict[str, TcpDevice | UdpDevice]) -> None:
    broker = MemoryBroker()
    listener = Listener(broker)
    before = threading.active_count()
    with MemoryBus(broker) as bus, ward(devices, bus):
        listener.until(lambda: all(listener.count(name) > 100 for name in devices))
    listener.until(lambda: all(listener.infos[name].samples == listener.count(name) for name in devices))
    for name, device in devices.items():
        assert unbroken(listener.batches[name])
        assert {batch.boot for batch in listener.batches[name]} == {device.device.boot}
        assert listener.infos[name].dropped == {}
    listener.until(lambda: threading.active_count() <= before)  # one of an earlier test may end meanwhile
    assert not udp_listener._listeners
    listener.close()


def test_a_connection_that_breaks_is_made_again_and_disturbs_nobody(devices: dict[str, TcpDevice | UdpDevice]) -> None:
    broker = MemoryBroker()
    listener = Listener(broker)
    with MemoryBus(broker) as bus, ward(devices, bus):
        listener.until(lambda: all(listener.count(name) > 20 for name in devices))
        broken = devices["t1"]
        assert isinstance(broken, TcpDevice)
        for number in range(1, 4):
            here = listener.count("t1")
            assert broken.client is not None
            broken.client.shutdown(socket.SHUT_RDWR)
            listener.until(lambda: listener.infos["t1"].events.get("reconnections") == number)  # noqa: B023
            listener.until(lambda: listener.count("t1") > here + 20)  # noqa: B023
        assert not listener.infos["t1"].trouble
    for name in ("t2", "u1", "u2"):
        assert unbroken(listener.batches[name])
        assert "reconnections" not in listener.infos[name].events
    listener.close()
