"""List of this machine's serial ports, each by its most stable name, with the description of its USB device."""

from pathlib import Path
from typing import NamedTuple

DEV = Path("/dev")
_KINDS = ("ttyUSB", "ttyACM", "rfcomm")


class Found(NamedTuple):
    """Serial port: the name to use, and the description of its USB device; "" if there is none."""

    port: str
    usb: str = ""


def find(dev: Path = DEV) -> list[Found]:
    """Return every serial port of this machine once, by its most stable name. dev: the folder /dev.

    Names are preferred in this order: by-id, which follows the device; by-path, which follows the USB socket; ttyUSB0,
    which follows neither.
    """
    from serial.tools.list_ports import comports  # noqa: PLC0415 - only a scan and doctor need it

    stable: dict[str, str] = {}
    for folder in ("serial/by-id", "serial/by-path"):
        for name in sorted((dev / folder).glob("*")):
            stable.setdefault(str(name.resolve()), str(name))
    return [
        Found(
            stable.get(port.device, port.device),
            " ".join(filter(None, (port.manufacturer, port.product, port.serial_number))),
        )
        for port in sorted(comports())
        if port.name.startswith(_KINDS)
    ]
