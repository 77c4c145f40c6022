import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

import numpy as np
import pytest
import serial

from bridge.framing.cobs_frames import Deframer, frame
from bridge.framing.packets import Charge, Data, Hello, decode, encode_identify
from bridge.sim.pty_port import PtyPort
from bridge.sim.virtual_device import DeviceSpec, VirtualDevice, demo_device
from bridge.wire.messages import DeviceCalibration
from tests.sim.recorded_source import RecordedSource


class Reader:
    """Opens the port as any program would and sorts what comes."""

    def __init__(self, link: Path, baudrate: int = 115200) -> None:
        self.port = serial.Serial(str(link), baudrate, exclusive=True, timeout=0.05)
        self.deframer = Deframer()
        self.said: list[Hello | Data | DeviceCalibration | Charge] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *args: object) -> None:
        self.port.close()

    def ask(self) -> None:
        self.port.write(frame(encode_identify()))

    def until(self, done: Callable[[], bool], timeout_s: float = 60.0) -> None:
        end = time.monotonic() + timeout_s
        while not done():
            assert time.monotonic() < end, f"not within {timeout_s} s, {len(self.said)} packets came"
            self.said += [decode(one) for one in self.deframer.feed(self.port.read(self.port.in_waiting or 1))]

    def boots(self) -> list[int]:
        return list(dict.fromkeys(one.boot for one in self.said if not isinstance(one, Charge)))

    def data(self) -> list[Data]:
        return [one for one in self.said if isinstance(one, Data)]


@pytest.fixture
def link(tmp_path: Path) -> Path:
    return tmp_path / "by-id" / "usb-virtual-a"


@pytest.mark.parametrize("baudrate", [9600, 115200, 921600, 250000, 31250])
def test_any_program_opens_it_at_any_speed_and_locks_it(link: Path, baudrate: int) -> None:
    with PtyPort(demo_device("a", 1), link, speed=20), Reader(link, baudrate) as reader:
        reader.until(lambda: len(reader.data()) > 10)
        with pytest.raises(serial.SerialException):
            serial.Serial(str(link), baudrate, exclusive=True)


@pytest.mark.parametrize("speed", [20, 50])
def test_a_replay_loses_nothing_however_slow_the_reader(link: Path, speed: int) -> None:
    gyro = np.random.default_rng(0).normal(size=(6000, 3)).astype(np.float32)
    device = VirtualDevice("a", RecordedSource(gyro, rate_hz=104), spec=DeviceSpec(wait_for_host=True))
    with PtyPort(device, link, speed=speed, lossless=True) as port:
        time.sleep(0.1)
        with Reader(link) as reader:
            reader.ask()
            reader.until(lambda: len(reader.data()) > 100)
            time.sleep(0.5)
            reader.until(lambda: len(reader.data()) == 3000)
        np.testing.assert_array_equal(np.concatenate([one.gyro for one in reader.data()]), gyro)
        assert not reader.deframer.faults.as_dict()
        assert port.dropped_bytes == 0
        assert device.finished
