"""A device that is a TCP server: `tcp://host:port`."""

import contextlib
import os
import socket

from bridge import host_time
from bridge.drivers.driver import DeviceLost, DeviceUnavailable
from bridge.transport import net_fault, url
from bridge.transport.receiver import RECEIVER, Kept
from bridge.transport.transport import Chunk
from bridge.wire.refusal import Tally

EXAMPLE = "tcp://10.0.0.5:8000"
_CONNECT_S = 1.5  # less than a bridge waits for a device's thread to end
_WRITE_S = 0.05  # the system's buffers take what little is sent, unless nothing was taken for long
_MOST_BYTES = 16_384  # understood in some 10 ms, be it what it may
# A device that lost power says no goodbye: after 3 s of silence it is asked, and given up 3 s later.
_IDLE_S, _ASK_EVERY_S, _ASKS = 3, 1, 3


class Connection:
    """An open connection; what comes is kept by the receiver's thread until it is taken."""

    def __init__(self, made: socket.socket) -> None:
        self.socket = made
        self.kept: Kept[Chunk] = Kept()
        self.loss: OSError | None = None  # behind the last of what is kept
        self.over = False
        made.settimeout(_WRITE_S)  # for writes; this also makes reads never wait
        self._fd = made.fileno()
        self._paused = False
        RECEIVER.add(self._fd, self._receive)

    def take(self, timeout_s: float) -> Chunk | None:
        """The next of what came; None if there is none, or at the end."""
        chunk = self.kept.take(timeout_s)
        if self._paused and not self.over and not self.kept.full:
            self._paused = False
            with contextlib.suppress(OSError):  # closed meanwhile
                RECEIVER.add(self._fd, self._receive)
        return chunk

    def close(self) -> None:
        """Disconnect."""
        self.over = True
        RECEIVER.remove(self._fd)
        with contextlib.suppress(OSError):
            self.socket.shutdown(socket.SHUT_RDWR)
        self.socket.close()
        self.kept.end()

    def _receive(self) -> None:
        """In the receiver's thread."""
        try:
            data = os.read(self._fd, _MOST_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self._end(error)
            return
        if not data:
            self._end(None)
            return
        self.kept.put(Chunk(data, host_time.now_ns()), len(data))
        if self.kept.full:  # the rest waits where it is, and in the end at the device
            RECEIVER.remove(self._fd)
            self._paused = True  # not before: who takes meanwhile would let it go on just before it is stopped

    def _end(self, error: OSError | None) -> None:
        RECEIVER.remove(self._fd)
        self.loss, self.over = error, True
        self.kept.end()


class TcpPort:
    """One connection. Whatever came before the device closed it is read before the loss is told."""

    keeps = True

    def __init__(self, address: str, baud: int) -> None:  # noqa: ARG002 - a network has no speed
        self.place = f"tcp://{address}"
        self.faults = Tally()
        self._address = parsed(address)
        self._connection: Connection | None = None

    def open(self) -> None:
        """Connect; raises DeviceUnavailable."""
        self.close()
        try:
            self._connection = Connection(_connected(self._address))
        except OSError as error:
            raise DeviceUnavailable(net_fault.cause(error, self.place)) from None

    def read(self, timeout_s: float) -> Chunk:
        """What came; raises DeviceLost."""
        opened = self._opened()
        was_over = opened.over
        chunk = opened.take(0.0 if was_over else timeout_s)
        if chunk is not None:
            return chunk
        if was_over or self._connection is not opened:  # before it was looked whether something is left
            raise DeviceLost(self._loss(opened))
        return Chunk(b"", host_time.now_ns())

    def write(self, data: bytes) -> None:
        """Send; raises DeviceLost when it is not taken. A connection that broke is told of by read, behind what came over it."""
        opened = self._opened()
        try:
            opened.socket.sendall(data)
        except TimeoutError:
            raise DeviceLost(f"{self.place}: the device does not take what is sent to it") from None
        except ConnectionError:
            pass
        except OSError as error:
            raise DeviceLost(net_fault.loss(error, self.place)) from None

    def close(self) -> None:
        """Disconnect, ending a read in another thread."""
        opened, self._connection = self._connection, None
        if opened is not None:
            opened.close()

    def _opened(self) -> Connection:
        opened = self._connection
        if opened is None:
            raise DeviceLost(f"{self.place}: closed")
        return opened

    def _loss(self, opened: Connection) -> str:
        if self._connection is None:
            return f"{self.place}: closed"
        if opened.loss is None:
            return f"{self.place}: the device closed the connection"
        return net_fault.loss(opened.loss, self.place)


def parsed(address: str) -> tuple[str, int]:
    """Host and port; ValueError where they are none."""
    before, _ = url.options(address, (), EXAMPLE)
    return url.host_port(before, EXAMPLE)


def state(address: str) -> str:
    """Whether it can be connected to now, in a few words; connects for a moment."""
    try:
        _connected(parsed(address)).close()
    except OSError as error:
        return net_fault.cause(error, "").removeprefix(": ")
    return "present"


def _connected(address: tuple[str, int]) -> socket.socket:
    made = socket.create_connection(address, _CONNECT_S)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    for name, value in (("TCP_KEEPIDLE", _IDLE_S), ("TCP_KEEPINTVL", _ASK_EVERY_S), ("TCP_KEEPCNT", _ASKS)):
        if hasattr(socket, name):  # macOS has not all of them
            made.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
    return made
