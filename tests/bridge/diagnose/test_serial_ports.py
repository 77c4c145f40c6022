"""Each port once, by its most stable name, with what its USB device says."""

from pathlib import Path

import pytest

from bridge.diagnose.serial_ports import Found, find


@pytest.fixture
def machine(tmp_path: Path) -> tuple[Path, Path]:
    """Four ports: one known by its id, two of one make without serial numbers, an old one on a board."""
    dev, sys = tmp_path / "dev", tmp_path / "sys"
    (dev / "serial/by-id").mkdir(parents=True)
    (dev / "serial/by-path").mkdir()
    for name in ("ttyUSB0", "ttyUSB2", "ttyUSB10", "ttyACM0", "ttyS0"):
        (dev / name).touch()
    (dev / "serial/by-id/usb-Silicon_Labs_CP2102_7-if00-port0").symlink_to("../../ttyUSB0")
    (dev / "serial/by-id/usb-1a86_USB_Serial-if00-port0").symlink_to("../../ttyUSB2")
    (dev / "serial/by-id/usb-left-over").symlink_to("../../ttyUSB9")
    for socket, name in (("1", "ttyUSB0"), ("2", "ttyUSB2"), ("3", "ttyUSB10")):
        (dev / f"serial/by-path/pci-usb-0:{socket}").symlink_to(f"../../{name}")
    device = sys / "devices/pci/usb1/1-1"
    (device / "1-1:1.0/ttyUSB0").mkdir(parents=True)
    for name, text in (("manufacturer", "Silicon Labs\n"), ("product", "CP2102 [x]\n"), ("serial", "7\n")):
        (device / name).write_text(text)
    (sys / "class/tty/ttyUSB0").mkdir(parents=True)
    (sys / "class/tty/ttyUSB0/device").symlink_to(device / "1-1:1.0/ttyUSB0")
    return dev, sys


def test_a_port_is_called_by_its_most_stable_name(machine: tuple[Path, Path]) -> None:
    dev, sys = machine
    assert find(dev, sys) == [
        Found(f"{dev}/serial/by-id/usb-1a86_USB_Serial-if00-port0", ""),
        Found(f"{dev}/serial/by-id/usb-Silicon_Labs_CP2102_7-if00-port0", "Silicon Labs CP2102 [x] 7"),
        Found(f"{dev}/serial/by-path/pci-usb-0:3", ""),
        Found(f"{dev}/ttyACM0", ""),
    ]


def test_a_machine_without_ports_has_none(tmp_path: Path) -> None:
    assert find(tmp_path, tmp_path) == []
