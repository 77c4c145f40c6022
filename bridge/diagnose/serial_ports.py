"""Lists this machine's serial ports, each by its most stable name, with the description of its USB device."""

import re
from pathlib import Path
from typing import NamedTuple

DEV, SYS = Path("/dev"), Path("/sys")
_KINDS = ("ttyUSB*", "ttyACM*", "rfcomm*")


class Found(NamedTuple):
    """A serial port: the name to use, and its USB device in words, empty if there is none."""

    port: str
    usb: str = ""


def find(dev: Path = DEV, sys: Path = SYS) -> list[Found]:
    """Return every serial port of this machine once, by its most stable name. dev, sys: the folders /dev and /sys.

    by-id names stay with the device, by-path names with the USB socket, ttyUSB0 with neither.
    """
    named: dict[Path, Path] = {}
    for names in (
        sorted((dev / "serial/by-id").glob("*")),
        sorted((dev / "serial/by-path").glob("*")),
        *(sorted(dev.glob(kind), key=_numbered) for kind in _KINDS),
    ):
        for name in names:
            if name.exists():
                named.setdefault(name.resolve(), name)
    return [Found(str(name), _usb(real.name, sys)) for real, name in named.items()]


def _numbered(path: Path) -> tuple[str, int]:
    digits = re.search(r"\d+\Z", path.name)
    return path.name.rstrip("0123456789"), int(digits[0]) if digits else 0


def _usb(terminal: str, sys: Path) -> str:
    """Manufacturer, product and serial number of the first device above the terminal that has a product."""
    device = sys / "class/tty" / terminal / "device"
    if not device.exists():
        return ""
    for folder in (device.resolve(), *device.resolve().parents):
        if (folder / "product").is_file():
            return " ".join(filter(None, (_text(folder / name) for name in ("manufacturer", "product", "serial"))))
        if folder == sys.resolve():
            break
    return ""


def _text(path: Path) -> str:
    try:
        return path.read_text(errors="replace").strip()
    except OSError:
        return ""
