"""Each port once, by its most stable name, with what its USB device says."""

from pathlib import Path

import pytest
from serial.tools.list_ports_common import ListPortInfo

from bridge.diagnose.serial_ports import Found, find


def test_a_port_is_called_by_its_most_stable_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for folder in ("by-id", "by-path"):
        (tmp_path / "serial" / folder).mkdir(parents=True)
    ports = {
        name: ListPortInfo(str(tmp_path / name)) for name in ("ttyUSB10", "ttyUSB2", "ttyUSB0", "ttyACM0", "ttyS0")
    }
    known = ports["ttyUSB0"]
    known.manufacturer, known.product, known.serial_number = "Silicon Labs", "CP2102 [x]", "7"
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: list(ports.values()))
    (tmp_path / "serial/by-id/usb-Silicon_Labs_CP2102_7-if00-port0").symlink_to("../../ttyUSB0")
    (tmp_path / "serial/by-id/usb-left-over").symlink_to("../../ttyUSB9")
    for socket, name in (("1", "ttyUSB0"), ("2", "ttyUSB2")):
        (tmp_path / f"serial/by-path/pci-usb-0:{socket}").symlink_to(f"../../{name}")
    assert find(tmp_path) == [
        Found(f"{tmp_path}/ttyACM0"),
        Found(f"{tmp_path}/serial/by-id/usb-Silicon_Labs_CP2102_7-if00-port0", "Silicon Labs CP2102 [x] 7"),
        Found(f"{tmp_path}/serial/by-path/pci-usb-0:2"),
        Found(f"{tmp_path}/ttyUSB10"),
    ]
