"""A bridge says what is wrong with a port in words that help, and goes on."""

from collections.abc import Callable
from pathlib import Path
from typing import cast

import pytest

from bridge.bus.memory_bus import MemoryBroker, MemoryBus
from bridge.config import Bridge, Device
from bridge.drivers import registry
from bridge.drivers.driver import DriverKind
from bridge.drivers.stream import StreamOptions
from bridge.ingest.pump import Pump
from bridge.sim.pty_port import PtyPort
from bridge.sim.virtual_device import VirtualDevice
from bridge.wire.messages import DeviceInfo
from tests.bridge.ingest.published.hearing import Listener
from tests.bridge.scan.protocol import KINDS, Talker, lines


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bridge.ingest.device_thread._SILENT_S", 0.3)


@pytest.fixture(autouse=True)
def kinds(monkeypatch: pytest.MonkeyPatch) -> None:
    found: dict[str, DriverKind] = {kind.name: kind for kind in KINDS}
    monkeypatch.setattr(registry, "kinds", lambda: found)


def talking(link: Path, said: bytes) -> PtyPort:
    return PtyPort(cast("VirtualDevice", Talker(said)), link)


def native(port: PtyPort) -> Device:
    return Device("d1", "native", StreamOptions(port=str(port.link)))


def told(listener: Listener, words: str) -> Callable[[], bool]:
    return lambda: "d1" in listener.infos and words in listener.infos["d1"].trouble


def trouble(broker: MemoryBroker, listener: Listener, device: Device, words: str) -> DeviceInfo:
    with MemoryBus(broker) as bus, Pump("w", Bridge(id="b1", batch_ms=20, devices=(device,)), bus):
        listener.until(told(listener, words))
    return listener.infos["d1"]


def test_another_protocol_is_named(tmp_path: Path, broker: MemoryBroker, listener: Listener) -> None:
    with talking(tmp_path / "port", lines(n=3000)) as port:
        said = trouble(broker, listener, native(port), "bytes come, but not native's").trouble
    assert (
        said
        == f"{port.link}: bytes come, but not native's; they look like driver = 'line': put that into the ward's file"
    )


def test_a_wrong_speed_is_suspected_and_its_bytes_are_counted(
    tmp_path: Path, broker: MemoryBroker, listener: Listener
) -> None:
    with talking(tmp_path / "port", bytes((i * 37) % 256 for i in range(5000))) as port:
        info = trouble(broker, listener, native(port), "another speed, or another protocol?")
    assert f"`truerate bridge scan --port {port.link}` finds out" in info.trouble
    assert sum(info.events.values()) > 0


def test_a_device_that_says_nothing_is_told_from_one_that_is_not_understood(
    tmp_path: Path, broker: MemoryBroker, listener: Listener
) -> None:
    with talking(tmp_path / "port", b"") as port:
        trouble(broker, listener, native(port), "open, but nothing comes; is it on, and sending?")
