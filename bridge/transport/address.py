"""Transports by device address: a serial port is named by its path, any other transport by `scheme://...`."""

from collections.abc import Callable
from typing import NamedTuple

from bridge.toml.loader import nearest
from bridge.transport import ble_port, file_port, serial_errors, tcp_port, udp_port
from bridge.transport.ble_port import BlePort
from bridge.transport.file_port import FilePort
from bridge.transport.tcp_port import TcpPort
from bridge.transport.transport import Transport
from bridge.transport.udp_port import UdpPort


class Scheme(NamedTuple):
    """Kind of transport, chosen by the scheme of a device's address, such as `tcp`.

    make(address, baud): creates a transport, which is not opened yet. state(address): returns in a few words if the
    address could be opened now. address: the part behind `scheme://`, or the path of a serial port. baud: bits per
    second. Both functions raise ValueError with the expected form if the address is invalid.
    """

    make: Callable[[str, int], Transport]
    state: Callable[[str], str]


def _serial_port(port: str, baud: int) -> Transport:
    from bridge.transport.serial_port import SerialPort  # noqa: PLC0415 - Windows has no termios

    return SerialPort(port, baud)


_SERIAL = Scheme(_serial_port, serial_errors.state)
SCHEMES: dict[str, Scheme] = {
    "tcp": Scheme(TcpPort, tcp_port.state),
    "udp": Scheme(UdpPort, udp_port.state),
    "file": Scheme(FilePort, file_port.state),
    "ble": Scheme(BlePort, ble_port.state),
}


def transport(port: str, baud: int) -> Transport:
    """Create the transport for a device's address; it is not opened yet.

    port: path of a serial port, or `scheme://...`. baud: bits per second of a serial port.
    Raises ValueError for an invalid address.
    """
    scheme, address = _split(port)
    return scheme.make(address, baud)


def state(port: str) -> str:
    """Return in a few words if a device's address could be opened now; no data is exchanged with the device.

    The result is `present` (for UDP `free`) if the address could be opened now. A BLE device is not searched for.
    port: path of a serial port, or `scheme://...`. Raises ValueError for an invalid address.
    """
    scheme, address = _split(port)
    return scheme.state(address)


def check(port: str, baud: int) -> None:
    """Check a device's address and a baud rate, 300 to 4000000 bits per second.

    port: path of a serial port, or `scheme://...`. Raises ValueError, with the expected form, if either is invalid.
    """
    if not port:
        raise ValueError("port is empty: name one; `truerate bridge scan` lists the connected devices")
    if not 300 <= baud <= 4_000_000:
        raise ValueError(f"baud is {baud}: use 300 to 4000000, usually 115200")
    scheme, address = _split(port)
    if scheme is not _SERIAL:
        scheme.make(address, baud)


def _split(port: str) -> tuple[Scheme, str]:
    name, separator, address = port.partition("://")
    if not separator:
        return _SERIAL, port
    if name not in SCHEMES:
        raise ValueError(f"port {port!r}: unknown scheme {name!r}; {nearest(name, SCHEMES)}")
    return SCHEMES[name], address
