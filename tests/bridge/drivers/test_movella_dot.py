"""The Movella DOT, against a device written from its specification: on bumble's virtual controllers, and on a wire."""

import struct
import time
from typing import Any

import numpy as np
import pytest
from bumble.core import UUID
from bumble.gatt import Characteristic, CharacteristicValue, Service

from bridge.config.schema import Device
from bridge.drivers.byte_stream import StreamDriver
from bridge.drivers.driver import Battery, Event, Identity, Readings
from bridge.drivers.movella_dot import MovellaDotDecoder, MovellaDotOptions
from bridge.framing.cobs_frames import Deframer
from bridge.transport import ble_loop, ble_port
from tests.bridge.drivers import dot_device
from tests.bridge.drivers.dot_device import BATTERY, CONTROL, DEVICE_CONTROL, INFO, LONG, MEDIUM, Dot
from tests.bridge.drivers.emulated_line import Wire
from tests.bridge.transport.ble_air import Air, made, settle


def driver_of(**more: object) -> StreamDriver:
    made_of = Device.from_table({"id": "d", "driver": "movella_dot", "port": "ble://F0:00:00:00:00:77", **more}).make()
    assert isinstance(made_of, StreamDriver)
    return made_of


def degrees(events: list[Event]) -> np.ndarray[Any, np.dtype[np.float64]]:
    gyro = np.concatenate([event.gyro for event in events if isinstance(event, Readings)]).astype(np.float64)
    return np.degrees(gyro)


class DotOnAir:
    """A DOT's characteristics on a virtual controller."""

    def __init__(self, air: Air, dot: Dot) -> None:
        self.dot = dot
        self._device = air.device("F0:00:00:00:00:77")
        flags, may = Characteristic.Properties, Characteristic.Permissions
        self.there: dict[int, Any] = {}
        for number, how in (
            (INFO, flags.READ),
            (DEVICE_CONTROL, flags.READ | flags.WRITE),
            (CONTROL, flags.READ | flags.WRITE),
            (LONG, flags.NOTIFY),
            (MEDIUM, flags.NOTIFY),
            (BATTERY, flags.READ | flags.NOTIFY),
        ):
            value = CharacteristicValue(
                read=lambda _, number=number: dot.read(number),
                write=lambda _, data, number=number: dot.write(number, data),
            )
            self.there[number] = Characteristic(UUID(dot_device.uuid(number)), how, may.READABLE | may.WRITEABLE, value)
        self._device.add_service(Service(UUID(dot_device.uuid(0x2000)), list(self.there.values())))

    async def be_seen(self) -> None:
        await self._device.power_on()
        await self._device.start_advertising(
            auto_restart=True, advertising_interval_min=20, advertising_interval_max=20
        )

    async def notify(self, number: int, *values: bytes) -> None:
        for each in values:
            await self._device.notify_subscribers(self.there[number], each)


@pytest.fixture
def on_air(monkeypatch: pytest.MonkeyPatch) -> DotOnAir:
    air, _ = made(0)
    monkeypatch.setattr(ble_port, "radio", lambda: air)

    async def make() -> DotOnAir:
        one = DotOnAir(air, Dot())
        await one.be_seen()
        return one

    return ble_loop.run(make()).result(60)


def test_a_dot_is_set_started_and_read_over_ble(on_air: DotOnAir) -> None:
    driver, dot = driver_of(rate_hz=30), on_air.dot
    driver.open()
    events: list[Event] = []
    try:
        end = time.monotonic() + 60
        while not dot.measuring:
            assert time.monotonic() < end
            events += driver.read(0.05)
        assert [number for number, _ in dot.written] == [CONTROL, DEVICE_CONTROL, CONTROL]
        assert (dot.rate_hz, dot.mode) == (30, 21)
        ble_loop.run(on_air.notify(MEDIUM, *(dot.payload() for _ in range(60)))).result(60)
        ble_loop.run(on_air.notify(BATTERY, b"\x56\x01")).result(60)
        settle()
        while Battery(86.0, charging=True) not in events:
            assert time.monotonic() < end
            events += driver.read(0.05)
    finally:
        driver.close()
    assert Battery(87.0) in events
    [identity] = [event for event in events if isinstance(event, Identity)]
    assert (identity.model, identity.firmware, identity.rate_hz) == ("Movella DOT XS-T02", "2.3.1", 30.0)
    assert degrees(events) == pytest.approx(np.array([[0.1 * i, 1, -2] for i in range(60)]), abs=1e-5)
    assert driver.faults.as_dict() == {}


class DotOnWire(Dot):
    """The same device, its values framed as the transport frames them."""

    def __init__(self) -> None:
        super().__init__()
        self.out, self._owed, self.silent = b"", 0.0, False

    def receive(self, data: bytes) -> None:
        for payload in Deframer().feed(data):
            number, given = int.from_bytes(payload[:2], "little"), payload[2:]
            if given:
                self.write(number, given)
            else:
                self.out += dot_device.value(number, self.read(number))

    def advance(self, seconds: float) -> bytes:
        if self.measuring and not self.silent:
            self._owed += seconds * self.rate_hz
            while self._owed >= 1:
                self._owed -= 1
                self.out += dot_device.value(MEDIUM, self.payload())
        out, self.out = self.out, b""
        return out


def test_another_payload_and_the_sensor_s_own_rate() -> None:
    bench = Wire(DotOnWire(), MovellaDotDecoder(options(payload="custom_3"))).run(4)
    assert bench.device.mode == 24
    assert DEVICE_CONTROL not in {number for number, _ in bench.device.written}
    identity = bench.identities[-1]
    assert (identity.rate_hz, identity.has_accel) == (60.0, False)
    turned = degrees(bench.events)
    assert turned == pytest.approx(np.array([[0.1 * i, 1, -2] for i in range(len(turned))]), abs=1e-5)
    assert len(turned) > 200


def test_a_dot_that_falls_silent_is_started_again_and_goes_on() -> None:
    bench = Wire(DotOnWire(), MovellaDotDecoder(options(rate_hz=60))).run(3)
    bench.device.measuring = False
    bench.run(6)
    assert bench.device.measuring
    assert len({identity.boot for identity in bench.identities}) == 1
    assert bench.notices == []


def test_a_dot_that_never_starts_is_said_to_be_silent() -> None:
    device = DotOnWire()
    device.silent = True
    assert "does not answer request start" in " ".join(Wire(device, MovellaDotDecoder(options())).run(15).notices)


def test_values_that_are_too_short_are_counted() -> None:
    decoder = MovellaDotDecoder(None)
    short = dot_device.value(MEDIUM, struct.pack("<I5f", 1, *[0.0] * 5)) + dot_device.value(BATTERY, b"\xff\0")
    assert decoder.feed(short + dot_device.value(LONG, bytes(63)), 1) == []
    assert decoder.faults.as_dict() == {"value_odd": 2, "value_of_another_mode": 1}


def options(**more: Any) -> MovellaDotOptions:
    return MovellaDotOptions(port="ble://D4:22:CD:00:12:34", **more)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"payload": "custom_2"}, "'custom_2' cannot be read: the payload carries no angular velocity"),
        ({"payload": "high_fidelity"}, "only the vendor's own software can decode it; use rate_quantities"),
        ({"payload": "rate_quantitys"}, "unknown payload 'rate_quantitys'; did you mean 'rate_quantities'"),
        ({"rate_hz": 100}, "rate_hz is 100: use one of 1, 4, 10, 12, 15, 20, 30, 60"),
        (
            {"port": "ble://D4:22:CD:00:12"},
            "'D4:22:CD:00:12' is not a Bluetooth address: write a port such as 'ble://D4",
        ),
        ({"port": "/dev/ttyUSB0"}, "a DOT has only Bluetooth"),
    ],
)
def test_options_that_cannot_work_are_refused_in_words(table: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        driver_of(**table)
