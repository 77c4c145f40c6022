"""TCP transport for a device that is a server: `tcp://host:port`."""

import contextlib
import socket

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.transport import host_time, network_errors, url
from bridge.transport.errors import DeviceLost, DeviceUnavailable
from bridge.transport.transport import Chunk
from bridge.wire.refusal import Tally

EXAMPLE = "tcp://10.0.0.5:8000"
_CONNECT_S = 1.5  # shorter than a bridge waits for a device's thread to end
_WRITE_S = 1.0
_MOST_BYTES = 16_384
# A device that lost power does not close the connection: keepalive probes start after 3 s of silence, and give up 3 s
# later.
_IDLE_S, _ASK_EVERY_S, _ASKS = 3, 1, 3


class TcpPort:
    """TCP transport for a device that is a server. address: `host:port`. baud: ignored.

    Data that arrived before the device closed the connection are read before DeviceLost is raised.
    """

    def __init__(self, address: str, baud: int) -> None:  # noqa: ARG002 - TCP has no baud rate
        self.place = f"tcp://{address}"
        self.faults = Tally()
        self._address = parsed(address)
        self._socket: socket.socket | None = None

    def open(self) -> None:
        """Connect to the device, within 1.5 s. Raises DeviceUnavailable if that fails."""
        self.close()
        try:
            self._socket = _connected(self._address)
        except OSError as error:
            raise DeviceUnavailable(network_errors.cause(error, self.place)) from None

    def read(self, timeout_s: float) -> Chunk:
        """Return received bytes with their receive time; waits at most timeout_s seconds for the first byte.

        The chunk has no bytes if none came. Raises DeviceLost if the connection has ended.
        """
        opened = self._opened()
        try:
            opened.settimeout(timeout_s)
            data = opened.recv(_MOST_BYTES)
        except OSError as error:
            self._opened()
            if _waited(error):
                return Chunk(b"", host_time.now_ns())
            raise DeviceLost(network_errors.loss(error, self.place)) from None
        if not data:
            self._opened()
            raise DeviceLost(Code.CONNECTION_CLOSED(place=self.place))
        return Chunk(data, host_time.now_ns())

    def write(self, data: bytes) -> None:
        """Send data to the device. Raises DeviceLost if the connection does not accept the data within a second.

        A broken connection raises nothing here: `read` first returns the data that arrived, then raises DeviceLost.
        """
        opened = self._opened()
        try:
            opened.settimeout(_WRITE_S)
            opened.sendall(data)
        except TimeoutError:
            raise DeviceLost(Code.NOT_TAKEN(place=self.place)) from None
        except ConnectionError:
            pass
        except OSError as error:
            raise DeviceLost(network_errors.loss(error, self.place)) from None

    def close(self) -> None:
        """Disconnect from the device; this ends a `read` in another thread."""
        opened, self._socket = self._socket, None
        if opened is not None:
            with contextlib.suppress(OSError):
                opened.shutdown(socket.SHUT_RDWR)
            opened.close()

    def _opened(self) -> socket.socket:
        opened = self._socket
        if opened is None:
            raise DeviceLost(Code.CLOSED(place=self.place))
        return opened


def _waited(error: OSError) -> bool:
    """Return whether no data came in time. A connection whose device no longer answers has an error number."""
    return isinstance(error, BlockingIOError) or (isinstance(error, TimeoutError) and error.errno is None)


def parsed(address: str) -> tuple[str, int]:
    """Parse the part of a TCP address behind `tcp://`; return (host, port). Raises ValueError for an invalid address."""
    before, _ = url.options(address, (), EXAMPLE)
    return url.host_port(before, EXAMPLE)


def state(address: str) -> str:
    """Return `present` if a device accepts a connection, else the cause in words; the connection is closed at once.

    address: `host:port`. Raises ValueError for an invalid address.
    """
    try:
        _connected(parsed(address)).close()
    except OSError as error:
        return english(network_errors.cause(error, f"tcp://{address}"))
    return "present"


def _connected(address: tuple[str, int]) -> socket.socket:
    made = socket.create_connection(address, _CONNECT_S)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    for name, value in (("TCP_KEEPIDLE", _IDLE_S), ("TCP_KEEPINTVL", _ASK_EVERY_S), ("TCP_KEEPCNT", _ASKS)):
        if hasattr(socket, name):  # macOS lacks some
            made.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
    return made
