"""Serial port transport, by pyserial.

Not every fault of a port is a SerialException. `in_waiting` of an unplugged port raises OSError. The terminal's own
calls raise termios.error, which is not an OSError.
"""

import contextlib
import os
import select
import termios
import threading
from typing import NamedTuple

import serial

from bridge.reasons.codes import Code, Sentence
from bridge.transport import host_time, serial_errors
from bridge.transport.errors import DeviceLost, DeviceUnavailable
from bridge.transport.port_holders import holders
from bridge.transport.transport import Chunk
from bridge.wire.refusal import Tally

_FAULTS = (serial.SerialException, OSError, termios.error)
_WRITE_TIMEOUT_S = 1.0
_MOST_BYTES = 65_536


class _Open(NamedTuple):
    """An open port, its poll object, and the two ends of a pipe: to close the second ends a wait on the first."""

    port: serial.Serial
    poll: select.poll
    wake: tuple[int, int]


class SerialPort:
    """Serial port transport of one device; the port is locked for this process.

    port: path of the port. /dev/serial/by-id/... is stable; /dev/ttyUSB0 may change. baud: bits per second.

    Many boards boot when DTR falls or rises. Opening a port always raises DTR and RTS. Afterwards
    neither this class nor the system, on close, lowers them. So only the first opening after plugging in may boot the
    board. Lowering the lines would silence boards with native USB, and reset an ESP32.
    """

    def __init__(self, port: str, baud: int) -> None:
        self.place = port
        self.faults = Tally()
        self.baud = baud
        self._closing = threading.Lock()
        self._open: _Open | None = None

    def open(self) -> None:
        """Open and lock the serial port. Raises DeviceUnavailable, which states the cause and what to do."""
        self.close()
        if not os.path.exists(self.place):  # noqa: PTH110 - called often for many missing ports: half the cost of Path
            raise DeviceUnavailable(Code.PORT_MISSING(place=self.place), soon=True)
        if serial_errors.no_port(self.place):
            raise DeviceUnavailable(Code.NOT_A_SERIAL_PORT(place=self.place))
        opened = serial.Serial(exclusive=True, write_timeout=_WRITE_TIMEOUT_S, timeout=0.2)
        try:
            opened.port, opened.baudrate = self.place, self.baud
            opened.open()
            _stay_powered(opened.fileno())
        except (*_FAULTS, ValueError) as error:
            _close(opened)
            said = serial_errors.cause(error, self.place)
            raise DeviceUnavailable(said, soon=serial_errors.settling(error)) from None
        wake = os.pipe()
        poll = select.poll()
        for fd in (opened.fileno(), wake[0]):
            poll.register(fd, select.POLLIN)
        self._open = _Open(opened, poll, wake)

    def read(self, timeout_s: float) -> Chunk:
        """Return received bytes with their receive time; waits at most timeout_s seconds for the first byte.

        The chunk has no bytes if none came. Raises DeviceLost if the port is gone.
        The result equals pyserial's read(in_waiting or 1), at a third of the cost: pyserial makes several system calls.
        """
        opened = self._opened()
        try:
            fd = opened.port.fileno()
            if not opened.poll.poll(timeout_s * 1e3):
                return Chunk(b"", host_time.now_ns())
            if self._open is not opened:  # closed meanwhile: the descriptor may belong to another file
                raise DeviceLost(Code.CLOSED(place=self.place))
            data = os.read(fd, _MOST_BYTES)
        except (*_FAULTS, TypeError) as error:  # TypeError: another thread closed the port
            raise DeviceLost(self._loss(error)) from None
        if not data:  # readable without data: the port is gone
            raise DeviceLost(self._loss(OSError()))
        return Chunk(data, host_time.now_ns())

    def write(self, data: bytes) -> None:
        """Send data to the device. Raises DeviceLost if the port is gone, or does not accept the data within a second."""
        opened = self._opened()
        try:
            opened.port.write(data)
        except (*_FAULTS, TypeError) as error:
            raise DeviceLost(self._loss(error)) from None

    def close(self) -> None:
        """Close the port; this ends a `read` in another thread. Never raises."""
        with self._closing:
            opened, self._open = self._open, None
        if opened is not None:
            os.close(opened.wake[1])
            _close(opened.port)
            os.close(opened.wake[0])

    def _opened(self) -> _Open:
        opened = self._open
        if opened is None:
            raise DeviceLost(Code.CLOSED(place=self.place))
        return opened

    def _loss(self, error: Exception) -> Sentence:
        if isinstance(error, serial.SerialTimeoutException):
            return Code.NOT_TAKEN(place=self.place)
        if self._open is None:
            return Code.CLOSED(place=self.place)
        others = [holder for holder in holders(self.place) if holder.pid != os.getpid()]
        if others:
            return Code.PORT_SHARED(place=self.place, holders=", ".join(map(str, others)))
        return Code.PORT_LOST(place=self.place)


def _stay_powered(fd: int) -> None:
    """Keep the modem lines up on close: dropping them resets many boards."""
    attributes = termios.tcgetattr(fd)
    attributes[2] &= ~termios.HUPCL
    termios.tcsetattr(fd, termios.TCSANOW, attributes)


def _close(opened: serial.Serial) -> None:
    with contextlib.suppress(*_FAULTS, TypeError):
        opened.close()
