"""A serial port: the only file that imports pyserial.

Not every fault of a port is a SerialException: `in_waiting` of an unplugged one raises a plain OSError, the terminal's own
calls a termios.error, which is none.
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
    """An open port, what waits for it, and what ends the waiting."""

    port: serial.Serial
    poll: select.poll
    wake: int


class SerialPort:
    """One port, locked for us alone. Give it a stable name: /dev/serial/by-id/... stays, /dev/ttyUSB0 does not.

    Many boards boot when DTR falls or rises. To open a port raises DTR and RTS, whatever a program does; they are then
    never lowered, neither here nor by the system on close, so only the first to open a port after it was plugged in may
    boot the board. (To lower them would silence boards with a USB of their own, and reset an ESP32.)
    """

    def __init__(self, port: str, baud: int) -> None:
        self.place = port
        self.faults = Tally()
        self.baud = baud
        self._closing = threading.Lock()
        self._open: _Open | None = None

    def open(self) -> None:
        """Open and lock; raises DeviceUnavailable with the cause and what to do."""
        self.close()
        if not os.path.exists(self.place):  # noqa: PTH110 - asked often, of many missing ports: half the cost of Path
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
        wake = os.eventfd(0)
        poll = select.poll()
        for fd in (opened.fileno(), wake):
            poll.register(fd, select.POLLIN)
        self._open = _Open(opened, poll, wake)

    def read(self, timeout_s: float) -> Chunk:
        """What came, waiting at most timeout_s for a first byte; empty if none. Raises DeviceLost.

        As pyserial's read(in_waiting or 1), at a third of its cost: pyserial asks the system several times.
        """
        opened = self._opened()
        try:
            fd = opened.port.fileno()
            if not opened.poll.poll(timeout_s * 1e3):
                return Chunk(b"", host_time.now_ns())
            if self._open is not opened:  # closed meanwhile: the number may be of another file
                raise DeviceLost(Code.CLOSED(place=self.place))
            data = os.read(fd, _MOST_BYTES)
        except (*_FAULTS, TypeError) as error:  # a TypeError when another thread closes it meanwhile
            raise DeviceLost(self._loss(error)) from None
        if not data:  # ready, but nothing comes
            raise DeviceLost(self._loss(OSError()))
        return Chunk(data, host_time.now_ns())

    def write(self, data: bytes) -> None:
        """Send; raises DeviceLost, also when the device does not take it within a second."""
        opened = self._opened()
        try:
            opened.port.write(data)
        except (*_FAULTS, TypeError) as error:
            raise DeviceLost(self._loss(error)) from None

    def close(self) -> None:
        """Close, ending a read in another thread; never raises."""
        with self._closing:
            opened, self._open = self._open, None
        if opened is not None:
            os.eventfd_write(opened.wake, 1)
            _close(opened.port)
            os.close(opened.wake)

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
    """Do not drop the modem lines on close: on many boards that is a reset."""
    attributes = termios.tcgetattr(fd)
    attributes[2] &= ~termios.HUPCL
    termios.tcsetattr(fd, termios.TCSANOW, attributes)


def _close(opened: serial.Serial) -> None:
    with contextlib.suppress(*_FAULTS, TypeError):
        opened.close()
