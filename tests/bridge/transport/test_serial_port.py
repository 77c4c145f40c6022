"""A serial port on a real terminal: it is ours alone, never lowers its lines, and says who has it."""

import os
import termios
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.sim.pty_port import PtyPort
from bridge.sim.virtual_device import demo_device
from bridge.transport import serial_errors
from bridge.transport.errors import DeviceLost, DeviceUnavailable
from bridge.transport.port_holders import Holder, holders, locked
from bridge.transport.serial_port import SerialPort
from tests.bridge.diagnose.test_port_access import process


@pytest.fixture
def pty(tmp_path: Path) -> Iterator[PtyPort]:
    with PtyPort(demo_device("d", 1), tmp_path / "port") as port:
        yield port


def cflag(path: Path) -> int:
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        return int(termios.tcgetattr(fd)[2])
    finally:
        os.close(fd)


def open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def lower_on_close(path: Path) -> None:
    """As a terminal is before anybody made it otherwise."""
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
    attributes = termios.tcgetattr(fd)
    attributes[2] |= termios.HUPCL
    termios.tcsetattr(fd, termios.TCSANOW, attributes)
    os.close(fd)


@pytest.mark.parametrize("baud", [9600, 115_200, 250_000])
def test_the_lines_are_not_lowered_on_close_at_any_speed(pty: PtyPort, baud: int) -> None:
    lower_on_close(pty.link)
    assert cflag(pty.link) & termios.HUPCL
    port = SerialPort(str(pty.link), baud)
    port.open()
    port.read(0.5)
    assert not cflag(pty.link) & termios.HUPCL
    port.close()
    assert not cflag(pty.link) & termios.HUPCL


def test_a_second_reader_is_told_who_has_the_port(pty: PtyPort) -> None:
    first, second = SerialPort(str(pty.link), 9600), SerialPort(str(pty.link), 9600)
    assert serial_errors.state(str(pty.link)) == "present"
    first.open()
    with pytest.raises(DeviceUnavailable, match=rf"is busy: \S+ \(process {os.getpid()}\) has it open") as busy:
        second.open()
    assert not busy.value.soon
    first.close()
    second.open()
    second.close()


def test_closing_while_another_thread_reads_and_opens_leaves_nothing_behind(pty: PtyPort) -> None:
    port = SerialPort(str(pty.link), 9600)
    stop = threading.Event()

    def read() -> None:
        while not stop.is_set():
            try:
                port.open()
                while True:
                    port.read(0.1)
            except (DeviceLost, DeviceUnavailable):
                continue

    reader = threading.Thread(target=read, daemon=True)
    before = open_files()
    reader.start()
    for _ in range(200):
        port.close()
    stop.set()
    while reader.is_alive():
        port.close()
        reader.join(0.01)
    port.close()
    assert open_files() <= before  # what an earlier test has left may end meanwhile


def test_who_has_a_port_is_found_by_its_real_name(tmp_path: Path) -> None:
    proc, port, name = tmp_path / "proc", tmp_path / "ttyUSB0", tmp_path / "by-id"
    port.touch()
    name.symlink_to(port)
    process(proc, 7, "ModemManager", Path("/dev/null"), port)
    process(proc, 12, "cat", Path("/dev/null"), Path("socket:[1]"))
    (proc / "self").mkdir()
    assert holders(str(name), proc) == [Holder(7, "ModemManager")]
    assert str(Holder(7, "ModemManager")) == "ModemManager (process 7)"
    assert holders(str(tmp_path / "other"), proc) == []


def test_a_port_that_another_process_has_locked_is_known_even_of_another_user(tmp_path: Path) -> None:
    port = tmp_path / "ttyUSB0"
    port.touch()
    status = port.stat()
    place = f"{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}:{status.st_ino}"
    own = f"1: FLOCK  ADVISORY  WRITE {os.getpid()} {place} 0 EOF\n2: POSIX  ADVISORY  WRITE 5 {place} 0 EOF\n"
    (tmp_path / "locks").write_text(own)
    assert not locked(str(port), tmp_path)
    (tmp_path / "locks").write_text(f"{own}3: FLOCK  ADVISORY  WRITE 5 {place} 0 EOF\n")
    assert locked(str(port), tmp_path)
