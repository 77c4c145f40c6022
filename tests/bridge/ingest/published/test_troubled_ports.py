"""A bridge says what is wrong with a port in words that help, and goes on."""

from collections.abc import Callable
from pathlib import Path
from typing import cast

import pytest

from bridge.config.schema import Bridge, Device
from bridge.drivers import registry
from bridge.drivers.byte_stream import StreamOptions
from bridge.drivers.driver import DriverKind
from bridge.ingest.pump import Pump
from bridge.reasons.codes import Code
from bridge.sim.pty_port import PtyPort
from bridge.sim.virtual_device import VirtualDevice
from bridge.wire.messages import DeviceInfo
from tests.bridge.diagnose.protocol import KINDS, Talker, lines
from tests.bridge.ingest.published.hearing import Listener
from tests.memory_bus import MemoryBroker, MemoryBus
from tests.sentences import codes


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


def told(listener: Listener, code: Code) -> Callable[[], bool]:
    return lambda: "d1" in listener.infos and code in codes(listener.infos["d1"].trouble)


def trouble(broker: MemoryBroker, listener: Listener, device: Device, code: Code) -> DeviceInfo:
    with MemoryBus(broker) as bus, Pump("w", Bridge(id="b1", batch_ms=20, devices=(device,)), bus):
        listener.until(told(listener, code))
    return listener.infos["d1"]


def test_another_protocol_is_named(tmp_path: Path, broker: MemoryBroker, listener: Listener) -> None:
    with talking(tmp_path / "port", lines(n=3000)) as port:
        said = trouble(broker, listener, native(port), Code.LOOKS_LIKE).trouble
    assert said == (
        Code.BYTES_OF_ANOTHER(place=port.link, driver="native"),
        Code.LOOKS_LIKE(settings="driver = 'line'"),
    )


def test_a_wrong_speed_is_suspected_and_its_bytes_are_counted(
    tmp_path: Path, broker: MemoryBroker, listener: Listener
) -> None:
    with talking(tmp_path / "port", bytes((i * 37) % 256 for i in range(5000))) as port:
        info = trouble(broker, listener, native(port), Code.TRY_SCAN)
    assert Code.TRY_SCAN(place=port.link) in info.trouble
    assert sum(info.events.values()) > 0


def test_a_device_that_says_nothing_is_told_from_one_that_is_not_understood(
    tmp_path: Path, broker: MemoryBroker, listener: Listener
) -> None:
    with talking(tmp_path / "port", b"") as port:
        trouble(broker, listener, native(port), Code.NOTHING_COMES)
