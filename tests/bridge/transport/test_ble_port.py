"""The BLE transport, on bumble's virtual controllers: no radio, no root.

bleak itself needs BlueZ and an adapter, so it does not run here: of `BleakRadio` only the words for its faults are tried, and
its failure on a machine without BlueZ. What is around it (inbox, loop, turns, losses) is what runs in a ward.
"""

import threading
import time
from pathlib import Path

import bleak_retry_connector
import pytest
from bleak import BleakScanner
from bleak.backends.device import BLEDevice
from bleak.exc import (
    BleakBluetoothNotAvailableError,
    BleakBluetoothNotAvailableReason,
    BleakDeviceNotFoundError,
    BleakError,
)

from bridge.drivers.byte_stream import StreamOptions
from bridge.drivers.driver import Event, Identity, Readings
from bridge.drivers.native import ASK, KIND
from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.transport import address, ble_loop, ble_port
from bridge.transport.ble_port import BlePort, parsed
from bridge.transport.ble_radio import BleakRadio, RadioFault, fault
from bridge.transport.errors import DeviceLost, DeviceUnavailable
from tests.bridge.drivers.test_native import data, hello
from tests.bridge.transport.ble_air import Wearable, made, settle

BASE = "-0000-1000-8000-00805f9b34fb"


@pytest.fixture
def three(monkeypatch: pytest.MonkeyPatch) -> list[Wearable]:
    air, wearables = made(3)
    monkeypatch.setattr(ble_port, "radio", lambda: air)
    return wearables


def port(wearable: Wearable, write: str = "") -> BlePort:
    return BlePort(f"{wearable.address}/ffe4{write}", 0)


def send(wearable: Wearable, *pieces: bytes) -> None:
    ble_loop.run(wearable.notify(list(pieces))).result(60)


def read_until(one: BlePort, n: int) -> bytes:
    came = b""
    end = time.monotonic() + 60
    while len(came) < n:
        assert time.monotonic() < end
        came += one.read(0.5).data
    return came


def test_every_notification_of_three_devices_comes_once_and_in_order(three: list[Wearable]) -> None:
    ports = [port(wearable) for wearable in three]
    for one in ports:
        one.open()
    sent = [[bytes([number, i]) * 10 for i in range(100)] for number in range(3)]
    try:
        for wearable, pieces in zip(three, sent, strict=True):
            send(wearable, *pieces)
        assert [read_until(one, 1000) for one in ports] == [b"".join(pieces) for pieces in sent]
        assert [one.read(0).data for one in ports] == [b""] * 3
        assert sum(thread.name == ble_loop.NAME for thread in threading.enumerate()) == 1
        assert [one.faults.as_dict() for one in ports] == [{}] * 3
    finally:
        for one in ports:
            one.close()


def test_a_native_device_is_asked_and_read_over_ble(three: list[Wearable]) -> None:
    driver = KIND.make(StreamOptions(port=f"ble://{three[0].address}/ffe4?write=ffe9"))
    driver.open()
    try:
        driver.read(0.01)
        end = time.monotonic() + 60
        while not three[0].written:
            assert time.monotonic() < end
            settle()
        assert three[0].written == [ASK]
        stream = hello() + data(0) + data(2)
        send(three[0], *(stream[i : i + 20] for i in range(0, len(stream), 20)))
        events: list[Event] = []
        while sum(isinstance(event, Readings) for event in events) < 2:
            events += driver.read(1.0)
        assert isinstance(events[0], Identity)
    finally:
        driver.close()


def test_a_device_that_hangs_up_is_lost_after_its_last_word_and_found_again(three: list[Wearable]) -> None:
    one = port(three[0])
    one.open()
    send(three[0], b"last")
    settle()
    ble_loop.run(three[0].hang_up()).result(60)
    settle()
    assert read_until(one, 4) == b"last"
    with pytest.raises(DeviceLost, match="powered off, is out of range, or disconnected"):
        read_until(one, 1)
    one.close()
    one.open()
    send(three[0], b"back")
    assert read_until(one, 4) == b"back"
    one.close()
    one.close()
    with pytest.raises(DeviceLost, match="closed"):
        one.read(0)
    with pytest.raises(DeviceLost, match="closed"):
        one.write(b"x")


def test_what_is_not_there_is_said(three: list[Wearable]) -> None:
    with pytest.raises(DeviceUnavailable, match="F0:00:00:00:00:77/ffe4 is not heard"):
        BlePort("F0:00:00:00:00:77/ffe4", 0).open()
    with pytest.raises(DeviceUnavailable, match=r"has no characteristic 0000abcd-.* It has: .*ffe4"):
        BlePort(f"{three[0].address}/abcd", 0).open()
    settle()
    again = port(three[0])  # the connection that was of no use was given back
    again.open()
    again.close()


def test_addresses() -> None:
    assert parsed("c4:64:e3:12:34:56/FFE4") == ("C4:64:E3:12:34:56", f"0000ffe4{BASE}", "")
    long = "6e400003-b5a3-f393-e0a9-e50e24dcca9e"
    assert parsed(f"C4:64:E3:12:34:56/{long}?write=ffe9")[1:] == (long, f"0000ffe9{BASE}")
    assert address.state("ble://C4:64:E3:12:34:56/ffe4") == "not checked before the port is opened"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("C4:64:E3:12:34/ffe4", "not a Bluetooth address: write a port such as 'ble://"),
        ("C4:64:E3:12:34:56", "'' is not a characteristic"),
        ("C4:64:E3:12:34:56/ffe", "'ffe' is not a characteristic"),
        ("C4:64:E3:12:34:56/ffe4?wrte=ffe9", "unknown option 'wrte'; did you mean 'write'?"),
        ("C4:64:E3:12:34:56/ffe4?write=", "'' is not a characteristic"),
    ],
)
def test_what_is_no_address_is_refused_with_one_that_is(text: str, said: str) -> None:
    with pytest.raises(ValueError, match=said.replace("?", r"\?")):
        StreamOptions(port=f"ble://{text}")


def test_faults_of_bleak_say_what_to_do() -> None:
    off = BleakBluetoothNotAvailableError("off", BleakBluetoothNotAvailableReason.POWERED_OFF)
    none = BleakBluetoothNotAvailableError("no adapter", BleakBluetoothNotAvailableReason.NO_BLUETOOTH)
    assert fault(off).at("p") == Code.BLE_OFF(place="p")
    assert "no adapter" in english(fault(none).at("p"))
    assert fault(BleakDeviceNotFoundError("C4")).code == Code.BLE_NOT_HEARD
    assert fault(TimeoutError()).code == Code.BLE_NOT_HEARD
    assert fault(bleak_retry_connector.BleakNotFoundError("D4")).code == Code.BLE_NOT_HEARD
    assert fault(FileNotFoundError()).code == Code.BLE_SERVICE_SILENT
    assert fault(BleakError("some words")).at("p") == Code.PLACE_FAILED(place="p", error="some words")


def test_a_connection_that_bluez_aborts_is_made_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """bleak's client and its search are replaced; what tries again is bleak-retry-connector itself."""
    attempts: list[object] = []

    class Client:
        def __init__(self, device: BLEDevice, **options: object) -> None:
            self.address = device.address

        async def connect(self, **options: object) -> None:
            attempts.append(self.address)
            if len(attempts) < 3:
                raise BleakError("[org.bluez.Error.Failed] le-connection-abort-by-local")

        async def disconnect(self) -> None:
            attempts.append("disconnected")

    async def find(address: str, **options: object) -> BLEDevice | None:
        return BLEDevice(address, "DOT", None) if address.startswith("D4") else None

    monkeypatch.setattr(bleak_retry_connector, "BleakClientWithServiceCache", Client)
    monkeypatch.setattr(BleakScanner, "find_device_by_address", find)
    connection = ble_loop.run(BleakRadio().connect("D4:22:CD:00:12:34", lambda: None)).result(30)
    assert attempts == ["D4:22:CD:00:12:34"] * 3
    ble_loop.run(connection.close()).result(5)
    assert attempts[-1] == "disconnected"
    with pytest.raises(RadioFault, match=Code.BLE_NOT_HEARD):
        ble_loop.run(BleakRadio().connect("C4:22:CD:00:12:34", lambda: None)).result(30)


@pytest.mark.skipif(Path("/run/dbus/system_bus_socket").exists(), reason="this machine may have Bluetooth")
def test_a_machine_without_bluetooth_says_so() -> None:
    with pytest.raises(RadioFault, match=Code.BLE_SERVICE_SILENT):
        ble_loop.run(BleakRadio().connect("C4:64:E3:12:34:56", lambda: None)).result(30)
