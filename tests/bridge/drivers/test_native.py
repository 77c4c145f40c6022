"""The native driver: bytes in any chunking, reboots, unplugged ports; and the simulated and replayed drivers beside it."""

import os
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge.drivers.byte_stream import StreamDriver
from bridge.drivers.driver import Battery, Event, Identity, Readings
from bridge.drivers.native import ASK, NativeDecoder
from bridge.drivers.replayed import Playback, ReplayedDriver, ReplayedOptions, ReplaySegment
from bridge.drivers.simulated import SimulatedDriver, SimulatedOptions
from bridge.framing.cobs_frames import frame
from bridge.framing.packets import (
    Charge,
    Data,
    Hello,
    encode_battery,
    encode_data,
    encode_hello,
    encode_own,
    encode_rate,
)
from bridge.recording import Recording
from bridge.sim.pty_port import PtyPort
from bridge.sim.virtual_device import DeviceSpec, demo_device
from bridge.transport import serial_errors
from bridge.transport.errors import DeviceLost, DeviceUnavailable
from bridge.transport.serial_port import SerialPort
from bridge.wire.messages import DeviceCalibration


def hello(boot: int = 1, *, has_accel: bool = True, rate_hz: float = 100.0) -> bytes:
    return frame(encode_hello(Hello(boot, 1e-6, rate_hz, 4.0, has_accel, True, "model", "1.2")))


def data(sequence: int, n: int = 2, boot: int = 1) -> bytes:
    ticks = ((sequence + np.arange(n)) * 10_000).astype(np.uint32)
    ones = np.ones((n, 3), np.float32)
    return frame(encode_data(Data(boot, sequence, ticks, ones, ones, ones[:, 0])))


def told(events: list[Event]) -> list[str]:
    return [
        f"{event.boot}:{event.sequence}+{len(event.ticks)}"
        if isinstance(event, Readings)
        else f"hello {event.boot}"
        if isinstance(event, Identity)
        else str(event)
        for event in events
    ]


def rate(rate_hz: float) -> bytes:
    return frame(encode_rate(rate_hz))


def test_a_device_is_told_its_rate_until_it_has_it() -> None:
    decoder = NativeDecoder(100.0)
    assert decoder.to_send() == ASK
    decoder.feed(hello(rate_hz=100.0), 1)
    assert decoder.to_send() == b""
    decoder = NativeDecoder(100.0)
    decoder.to_send()
    for _ in range(3):
        decoder.feed(hello(rate_hz=200.0), 1)
        assert decoder.to_send() == rate(100.0)
    decoder.feed(hello(2, rate_hz=104.0), 1)
    assert decoder.to_send() == rate(100.0), "another boot has forgotten it"


def test_readings_wait_for_the_device_to_say_who_it_is() -> None:
    decoder = NativeDecoder()
    asks = [decoder.to_send()]
    asks.append(decoder.to_send())
    assert decoder.feed(data(0) + data(2), 1) == []
    asks.append(decoder.to_send())
    assert told(decoder.feed(hello() + data(4), 2)) == ["hello 1", "1:0+2", "1:2+2", "1:4+2"]
    asks.append(decoder.to_send())
    assert asks == [ASK, b"", ASK, b""]


def test_a_boot_that_was_not_announced_makes_it_ask() -> None:
    decoder = NativeDecoder()
    decoder.feed(hello() + data(0), 1)
    asks = [decoder.to_send()]
    assert decoder.feed(data(0, boot=2), 1) == []
    asks.append(decoder.to_send())
    assert asks == [b"", ASK]
    assert told(decoder.feed(hello(2), 1)) == ["hello 2", "2:0+2"]


def test_what_is_held_back_is_bounded_and_counted() -> None:
    decoder = NativeDecoder()
    for i in range(100):
        decoder.feed(data(2 * i), 1)
    assert decoder.faults.as_dict() == {"samples_of_unknown_boot": 72}
    assert decoder.to_send() == ASK
    assert len(decoder.feed(hello(9), 1)) == 1
    assert decoder.faults.as_dict() == {"samples_of_unknown_boot": 200}


def test_columns_that_are_not_real_are_left_out() -> None:
    decoder = NativeDecoder()
    _, readings = decoder.feed(hello(has_accel=False) + data(0), 1)
    assert isinstance(readings, Readings)
    assert readings.accel is None
    assert readings.temperature_c is not None


@pytest.fixture
def pty(tmp_path: Path) -> Iterator[PtyPort]:
    with PtyPort(demo_device("d", 1), tmp_path / "port") as port:
        yield port


def read_until(driver: StreamDriver | SimulatedDriver | ReplayedDriver, n: int, limit_s: float = 60.0) -> list[Event]:
    events: list[Event] = []
    end = time.monotonic() + limit_s
    while sum(isinstance(event, Readings) for event in events) < n:
        assert time.monotonic() < end, "the device says nothing"
        events += driver.read(0.1)
    return events


def test_what_is_no_port_is_unavailable_with_its_cause(tmp_path: Path) -> None:
    plain = tmp_path / "file"
    plain.touch()
    for path, cause in [
        (tmp_path / "none", "missing"),
        (plain, "not a serial port"),
        (Path("/dev/null"), "not a serial port"),
    ]:
        with pytest.raises(DeviceUnavailable, match=cause):
            SerialPort(str(path), 115_200).open()
        assert cause in serial_errors.state(str(path))
    with pytest.raises(DeviceUnavailable):
        SerialPort(str(tmp_path), 115_200).open()
    with pytest.raises(DeviceLost, match="closed"):
        SerialPort("/dev/null", 9600).read(0.1)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may open everything")
def test_a_port_without_permission_says_what_to_do(pty: PtyPort) -> None:
    Path(os.path.realpath(pty.link)).chmod(0)
    with pytest.raises(DeviceUnavailable, match="dialout"):
        SerialPort(str(pty.link), 115_200).open()


def test_a_simulated_device_of_a_new_process_is_a_new_boot_of_the_same_sensor() -> None:
    first, second = (SimulatedDriver(SimulatedOptions(seed=3)) for _ in range(2))
    for driver in (first, second):
        driver.open()
    one, two = first.device, second.device
    assert one is not None
    assert two is not None
    assert one.boot is not None
    assert two.boot is not None
    assert one.boot != two.boot
    assert np.array_equal(one.truth.sensor(one.boot).matrix, two.truth.sensor(two.boot).matrix)


def recording(time_s: list[float]) -> Recording:
    n = len(time_s)
    return Recording(np.array(time_s), np.arange(3.0 * n).reshape(n, 3), None, None, 10.0, "rec")


def test_a_playback_gives_what_is_due_and_numbers_what_is_missing() -> None:
    playback = Playback([ReplaySegment.of_recording(recording([0, 0.1, 0.2, 0.5, 0.6]), 5)], 2.0)
    assert playback.wait_s(0.0) == 0.0
    assert isinstance((events := playback.due(0.05, 1))[0], Identity)
    assert told(events[1:]) == ["5:0+2"]
    assert playback.wait_s(0.05) == pytest.approx(0.05)
    assert told(list(playback.due(0.06, 1))) == []
    assert told(list(playback.due(9.0, 1))) == ["5:2+1", "5:5+2"]
    assert playback.over


def test_a_replayed_recording_ends_for_good(tmp_path: Path) -> None:
    gyro = np.random.default_rng(0).normal(size=(500, 3))
    np.savez(tmp_path / "r.npz", gyro_rad_s=gyro, rate_hz=100.0)
    driver = ReplayedDriver(ReplayedOptions(file=str(tmp_path / "r.npz"), speed=100))
    driver.open()
    events = read_until(driver, 1)
    with pytest.raises(DeviceLost) as lost:
        events.extend(event for _ in range(1000) for event in driver.read(0.1))
    assert lost.value.over
    assert isinstance(events[0], Identity)
    played = np.concatenate([event.gyro for event in events if isinstance(event, Readings)])
    assert np.array_equal(played, gyro)
    driver.close()


def test_a_missing_recording_is_unavailable(tmp_path: Path) -> None:
    with pytest.raises(DeviceUnavailable, match="cannot be read"):
        ReplayedDriver(ReplayedOptions(file=str(tmp_path / "none.npz"))).open()


def test_samples_of_a_boot_that_was_never_told_are_counted_when_the_port_is_lost() -> None:
    decoder = NativeDecoder()
    decoder.feed(data(0), 1)
    decoder.opened()
    assert decoder.faults.as_dict() == {"samples_of_unknown_boot": 2}
    decoder.feed(data(2, 3), 2)
    assert decoder.finish() == []
    assert decoder.faults.as_dict() == {"samples_of_unknown_boot": 5}
    assert decoder.finish() == []
    assert decoder.faults.as_dict() == {"samples_of_unknown_boot": 5}


OWN = DeviceCalibration(1, 7, (0.5, 1.0, 1.25), (0.0, -0.25, 0.5))


def test_a_calibration_of_the_device_s_own_comes_as_it_was_sent() -> None:
    decoder = NativeDecoder()
    assert decoder.feed(hello() + frame(encode_own(OWN)), 1)[1:] == [OWN]


@pytest.mark.parametrize(
    "wrong",
    [replace(OWN, scale=(float("nan"), 1.0, 1.0)), replace(OWN, bias=(0.0, 0.0, float("inf")))],
    ids=["k", "bias"],
)
def test_one_that_is_no_number_is_counted(wrong: DeviceCalibration) -> None:
    decoder = NativeDecoder()
    assert decoder.feed(hello() + frame(encode_own(wrong)), 1)[1:] == []
    assert decoder.faults.as_dict() == {"packet_content": 1}


def test_a_virtual_device_tells_its_battery_until_it_is_empty() -> None:
    device, decoder = demo_device("one", 1, spec=DeviceSpec(battery_s=100.0)), NativeDecoder()
    told = [e for s in range(1, 121) for e in decoder.feed(device.advance(float(s)), 0) if isinstance(e, Battery)]
    percents = [one.percent for one in told]
    assert percents == sorted(percents, reverse=True)
    assert (percents[0], percents[-1]) == (99.0, 0.0)
    device.reboot()
    again = [e for e in decoder.feed(device.advance(122.0), 0) if isinstance(e, Battery)]
    assert again[0].percent >= 98.0, "charged while it was off"
    assert decoder.faults.as_dict() == {}


@pytest.mark.parametrize("packet", [b"\x04\0\0", encode_battery(Charge(101.0, charging=False)), b"\x04\0\0\xc0\x7f\0"])
def test_a_battery_that_is_none_is_counted(packet: bytes) -> None:
    decoder = NativeDecoder()
    assert decoder.feed(hello() + frame(packet), 0)[1:] == []
    assert sum(decoder.faults.as_dict().values()) == 1
