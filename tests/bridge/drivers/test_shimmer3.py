"""The Shimmer3, against a device written from its protocol document."""

from collections.abc import Iterator
from math import radians
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from bridge.config.schema import Device
from bridge.drivers.driver import Battery, Event, Identity, Readings
from bridge.drivers.shimmer3 import Shimmer3Decoder, Shimmer3Options
from bridge.sim.pty_port import PtyPort
from bridge.sim.virtual_device import VirtualDevice
from tests.bridge.drivers.emulated_line import Wire
from tests.bridge.drivers.shimmer3_device import (
    CALIBRATION,
    CHANNELS,
    EVEN,
    TICKS,
    Shimmer,
    calibrations,
    crc,
    inquiry,
    packet,
    summed,
)


def bench(device: Shimmer, **more: Any) -> Wire[Shimmer]:
    return Wire(device, Shimmer3Decoder(Shimmer3Options(port="/dev/rfcomm0", **more)))


def gyro_of(events: list[Event]) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.concatenate([event.gyro for event in events if isinstance(event, Readings)])


def right(events: list[Event]) -> int:
    """Samples; fails unless each is one that the device sent, with its stored calibration, in order."""
    gyro = np.degrees(gyro_of(events))
    number = np.rint(10 - gyro[:, 1] * 65.5)  # y of the housing is −x of the chip, whose offset is 10
    assert gyro[:, 1] == pytest.approx(-(number - 10) / 65.5, abs=1e-9)
    assert gyro[:, 0] == pytest.approx(-(100 + 20) / 65.6)
    assert gyro[:, 2] == pytest.approx((100 + 30) / 65.4)
    assert (np.diff(number) > 0).all()
    return len(gyro)


def test_the_crc_is_that_of_a_published_example() -> None:
    assert crc(bytes.fromhex("2403020103")) == bytes.fromhex("cadc")
    assert crc(bytes.fromhex("24030201")) == bytes.fromhex("4bc2")


@pytest.mark.parametrize("knows_crc", [True, False])
def test_a_device_is_asked_calibrated_and_read_with_its_battery(*, knows_crc: bool) -> None:
    wire = bench(Shimmer(knows_crc=knows_crc)).run(12)
    identity = wire.identities[-1]
    assert (identity.model, identity.firmware, identity.rate_hz) == ("Shimmer3", "0.16.4", 102.4)
    assert identity.gyro_range == radians(500)
    assert wire.device.crc == knows_crc
    assert right(wire.events) >= wire.device.count - 1 > 600
    accel = wire.readings[0].accel
    assert accel is not None
    assert accel[0] == pytest.approx([0, 0, (2047 - 1233) / 83], abs=1e-9)
    [charge] = {event for event in wire.events if isinstance(event, Battery)}
    assert charge.percent == pytest.approx(98.6, abs=0.1)
    assert charge.charging
    assert wire.decoder.faults.as_dict() == {}
    assert wire.notices == []


def test_rate_and_sensors_are_set_on_request() -> None:
    wire = bench(Shimmer(), rate_hz=51.2).run(6)
    assert wire.device.ticks == 640
    assert wire.identities[-1].rate_hz == 51.2


@pytest.mark.parametrize("knows_crc", [True, False])
def test_lost_bytes_make_no_wrong_sample_and_are_counted(*, knows_crc: bool) -> None:
    wire = bench(Shimmer(knows_crc=knows_crc)).run(6)
    wire.device.lose = 97
    wire.run(30)
    assert right(wire.events) > 0.6 * wire.device.count
    assert wire.decoder.faults.as_dict()["bytes_between_frames"] > 0


@pytest.mark.parametrize(("checked", "lost", "least"), [(True, 0.2, 0.6), (False, 0.01, 0.97)])
def test_lost_notifications_make_no_wrong_sample(*, checked: bool, lost: float, least: float) -> None:
    rng, n = np.random.default_rng(1), 8000
    sent = rng.integers(-3000, 3000, (n, 3))
    frames = [b"\xff", b"\xff\x4a\x01", calibrations(EVEN), inquiry()]
    frames += [packet(TICKS * i, (int(x), int(y), int(z))) for i, (x, y, z) in enumerate(sent)]
    stream = b"".join(map(summed, frames) if checked else frames[1:])
    first = stream.index(packet(0, (0, 0, 0))[:10])
    decoder = Shimmer3Decoder(None)
    events = decoder.feed(stream[:first], 10**18)
    for at in range(first, len(stream), 20):
        if rng.random() > lost:
            events += decoder.feed(stream[at : at + 20], 10**18 + round(1e9 * (at - first) / len(frames[-1]) / 102.4))
    ticks = np.concatenate([event.ticks for event in events if isinstance(event, Readings)]).astype(np.int64)
    assert (ticks % TICKS == 0).all()
    x, y, z = sent[ticks // TICKS].T
    assert np.degrees(gyro_of(events)) * 100 == pytest.approx(-np.column_stack([y, x, z]), abs=1e-6)
    assert len(ticks) > least * n
    assert decoder.faults.as_dict()["bytes_between_frames"] > 0


def test_firmware_without_crc_is_not_read_where_bytes_may_be_lost() -> None:
    address = "ble://C4:64:E3:12:34:56/49535343-1e4d-4bd9-ba61-23c647249616?write=49535343-8841-43f4-a8d4-ecbe34729bb3"
    wire = Wire(Shimmer(knows_crc=False), Shimmer3Decoder(Shimmer3Options(port=address)))
    assert "does not answer request crc" in " ".join(wire.run(8).notices)
    assert not wire.device.streaming


def test_a_stream_that_stops_is_started_again() -> None:
    wire = bench(Shimmer()).run(6)
    wire.device.streaming = False
    wire.run(8)
    assert wire.device.streaming
    assert len({identity.boot for identity in wire.identities}) == 1


def test_without_a_stored_calibration_the_nominal_one_is_used_and_that_is_said() -> None:
    wire = bench(Shimmer(gyro=b"\xff" * 21)).run(6)
    assert "stores no calibration of its gyro" in " ".join(wire.notices)
    assert np.degrees(gyro_of(wire.events)[0, 2]) == pytest.approx(100 / 65.5)


def test_another_model_and_a_device_without_gyro_are_named() -> None:
    other = bench(Shimmer(version=10)).run(6)
    assert not other.device.streaming
    assert "hardware version is 10, but 3, a Shimmer3, is expected" in " ".join(other.notices)
    device = Shimmer()
    device.channels = CHANNELS[:3]
    assert "sends no gyro readings" in " ".join(bench(device).run(6).notices)


def test_a_gyro_at_the_end_of_its_range_is_said_to_be_clipped() -> None:
    wire = bench(Shimmer()).run(6)
    at = wire.device.count
    clipped = summed(packet(1000 + 320 * at, (32767, 0, 0)))
    [readings] = [e for e in wire.decoder.feed(clipped, wire.now_ns) if isinstance(e, Readings)]
    assert readings.clipped is not None
    assert readings.clipped.all()


@pytest.fixture
def plugged(tmp_path: Path) -> Iterator[PtyPort]:
    device = Shimmer()
    device.name = "shimmer"  # type: ignore[attr-defined]
    with PtyPort(cast("VirtualDevice", device), tmp_path / "rfcomm0") as port:
        yield port


def test_a_device_on_a_serial_port_is_read(plugged: PtyPort) -> None:
    driver = Device.from_table({"id": "d", "driver": "shimmer3", "port": str(plugged.link)}).make()
    driver.open()
    events: list[Event] = []
    try:
        for _ in range(600):
            events += driver.read(0.1)
            if sum(len(e.ticks) for e in events if isinstance(e, Readings)) > 100:
                break
    finally:
        driver.close()
    assert any(isinstance(event, Identity) for event in events)
    assert right(events) > 100
    assert CALIBRATION in plugged.device.gyro  # type: ignore[attr-defined]


def test_a_rate_that_cannot_be_set_is_refused() -> None:
    with pytest.raises(ValueError, match="rate_hz is 2000: use 1 to 1024"):
        Shimmer3Options(port="/dev/rfcomm0", rate_hz=2000)
