import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

import numpy as np
import pytest
import serial

from bridge.framing.deframer import Deframer, frame
from bridge.framing.packets import Data, Hello, decode, encode_identify
from bridge.sim.faults import BitErrors
from bridge.sim.pty_port import PtyPort
from bridge.sim.source import RecordedSource
from bridge.sim.virtual_device import DeviceSpec, VirtualDevice, demo_device


class Reader:
    """Opens the port as any program would and sorts what comes."""

    def __init__(self, link: Path, baudrate: int = 115200) -> None:
        self.port = serial.Serial(str(link), baudrate, exclusive=True, timeout=0.05)
        self.deframer = Deframer()
        self.said: list[Hello | Data] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *args: object) -> None:
        self.port.close()

    def ask(self) -> None:
        self.port.write(frame(encode_identify()))

    def until(self, done: Callable[[], bool], timeout_s: float = 20.0) -> None:
        end = time.monotonic() + timeout_s
        while not done():
            assert time.monotonic() < end, f"not within {timeout_s} s, {len(self.said)} packets came"
            self.said += [decode(one) for one in self.deframer.feed(self.port.read(self.port.in_waiting or 1))]

    def boots(self) -> list[int]:
        return list(dict.fromkeys(one.boot for one in self.said))

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


def test_it_answers_and_reboots(link: Path) -> None:
    device = demo_device("a", 1)
    with PtyPort(device, link, speed=20), Reader(link) as reader:
        reader.until(lambda: len(reader.data()) > 10)
        device.reboot()
        reader.until(lambda: len(reader.boots()) == 2)
        reader.until(lambda: reader.said[-1].boot == reader.boots()[1] and len(reader.data()) > 20)
        reader.ask()
        count = len(reader.said)
        reader.until(lambda: any(isinstance(one, Hello) for one in reader.said[count:]))


def test_unplugged_the_reader_gets_an_error_and_finds_the_same_boot_under_the_same_name(link: Path) -> None:
    with PtyPort(demo_device("a", 1), link, speed=5) as port:
        with Reader(link) as before:
            before.until(lambda: len(before.data()) > 10)
            port.unplug()
            with pytest.raises(OSError, match=r"."):
                before.until(lambda: False)
        assert not link.exists()
        with pytest.raises(serial.SerialException):
            Reader(link)
        time.sleep(0.2)
        port.plug()
        with Reader(link) as after:
            after.until(lambda: len(after.data()) > 10)
        assert after.boots() == before.boots()
        # It went on while nobody was there.
        assert after.data()[0].sequence > before.data()[-1].sequence + 50
        assert port.dropped_bytes > 0


def test_plugged_in_and_out_many_times_it_leaks_nothing(link: Path) -> None:
    def descriptors() -> int:
        return len(list(Path("/proc/self/fd").iterdir()))

    with PtyPort(demo_device("a", 1), link) as port:
        held = descriptors()
        for _ in range(100):
            port.unplug()
            port.unplug()
            port.plug()
            port.plug()
        assert descriptors() == held
        Reader(link).port.close()
    port.close()
    assert descriptors() == held - 2
    assert not link.is_symlink()


def test_a_reader_that_does_not_read_loses_bytes_but_never_gets_a_wrong_packet(link: Path) -> None:
    with PtyPort(demo_device("a", 1), link, speed=50) as port, Reader(link) as reader:
        reader.until(lambda: len(reader.data()) > 10)
        time.sleep(1.0)
        assert port.dropped_bytes > 50_000
        held = len(reader.data())
        reader.until(lambda: len(reader.data()) > held + 200)
        sequences = [one.sequence for one in reader.data()]
        assert sequences == sorted(set(sequences))
        assert reader.deframer.faults.as_dict()


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


def test_device_time_runs_as_fast_as_asked(link: Path) -> None:
    with PtyPort(demo_device("a", 1), link, speed=20) as port, Reader(link) as reader:
        begin, lived = time.monotonic(), port.device_time_s
        reader.until(lambda: time.monotonic() > begin + 1)
        assert port.device_time_s - lived == pytest.approx(20 * (time.monotonic() - begin), rel=0.5)


def test_a_bad_cable_costs_frames_only(link: Path) -> None:
    with PtyPort(demo_device("a", 1), link, speed=20, byte_fault=BitErrors(1e-4)), Reader(link) as reader:
        reader.until(lambda: len(reader.data()) > 1000 and bool(reader.deframer.faults.as_dict()))
        assert len(reader.boots()) == 1
