"""A serial port, and what its faults mean: the only file that imports pyserial.

Not every fault of a port is a SerialException: `in_waiting` of an unplugged one raises a plain OSError, the terminal's own
calls a termios.error, which is none.
"""

import contextlib
import errno
import fcntl
import os
import stat
import termios
import time
from pathlib import Path

import serial

from bridge.drivers.driver import DeviceLost, DeviceUnavailable
from bridge.transport.transport import Chunk
from bridge.wire.refusal import Tally

_FAULTS = (serial.SerialException, OSError, termios.error)
_WRITE_TIMEOUT_S = 1.0


class SerialPort:
    """One port, locked for us alone. Give it a stable name: /dev/serial/by-id/... stays, /dev/ttyUSB0 does not."""

    def __init__(self, port: str, baud: int) -> None:
        self.place = port
        self.faults = Tally()
        self.baud = baud
        self._serial: serial.Serial | None = None

    def open(self) -> None:
        """Open and lock; raises DeviceUnavailable with the cause and what to do."""
        self.close()
        opened = serial.Serial(exclusive=True, write_timeout=_WRITE_TIMEOUT_S, timeout=0.2)
        try:
            opened.port, opened.baudrate = self.place, self.baud
            opened.open()
            _stay_powered(opened.fileno())
        except (*_FAULTS, ValueError) as error:
            _close(opened)
            raise DeviceUnavailable(f"{self.place}: {_cause(error)}") from None
        self._serial = opened

    def read(self, timeout_s: float) -> Chunk:
        """What came, waiting at most timeout_s for a first byte; empty if none. Raises DeviceLost."""
        opened = self._opened()
        try:
            if opened.timeout != timeout_s:
                opened.timeout = timeout_s  # a system call, so not each time
            waiting = opened.in_waiting
            data = opened.read(waiting or 1)
            if data and not waiting:  # that was the first byte only
                data += opened.read(opened.in_waiting)
        except (*_FAULTS, TypeError) as error:  # a TypeError when another thread closes it meanwhile
            raise DeviceLost(f"{self.place}: {_loss(error)}") from None
        return Chunk(data, time.time_ns())

    def write(self, data: bytes) -> None:
        """Send; raises DeviceLost, also when the device does not take it within a second."""
        opened = self._opened()
        try:
            opened.write(data)
        except (*_FAULTS, TypeError) as error:
            raise DeviceLost(f"{self.place}: {_loss(error)}") from None

    def close(self) -> None:
        """Close, ending a read in another thread; never raises."""
        opened, self._serial = self._serial, None
        if opened is not None:
            with contextlib.suppress(*_FAULTS, AttributeError):
                opened.cancel_read()
            _close(opened)

    def _opened(self) -> serial.Serial:
        opened = self._serial
        if opened is None:
            raise DeviceLost(f"{self.place}: closed")
        return opened


def state(port: str) -> str:
    """Whether a port could be opened now, in a few words; opens it for a moment, without waking the device's modem lines."""
    try:
        fd = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError as error:
        return _cause(error)
    try:
        if not stat.S_ISCHR(os.fstat(fd).st_mode) or not os.isatty(fd):
            return "not a serial port"
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return _cause(error)
    finally:
        os.close(fd)
    return "present"


def _stay_powered(fd: int) -> None:
    """Do not drop the modem lines on close: on many boards that is a reset."""
    attributes = termios.tcgetattr(fd)
    attributes[2] &= ~termios.HUPCL
    termios.tcsetattr(fd, termios.TCSANOW, attributes)


def _close(opened: serial.Serial) -> None:
    with contextlib.suppress(*_FAULTS, TypeError):
        opened.close()


def _cause(error: Exception) -> str:
    """Why a port cannot be opened, and what to do."""
    number = error.errno if isinstance(error, OSError) else (error.args or [None])[0]
    if number in {errno.ENOENT, errno.ENODEV, errno.ENXIO}:
        return f"missing; plug the device in, or choose one of {_present()}"
    if number in {errno.EACCES, errno.EPERM}:
        return "no permission; add the user to group dialout (sudo usermod -aG dialout $USER) and log in again"
    if number in {errno.EBUSY, errno.EAGAIN}:
        return "busy; another program has it open: close that one"
    if number in {errno.ENOTTY, errno.EINVAL, errno.EISDIR} or "configure port" in str(error):
        return "not a serial port"
    return str(error)


def _present() -> str:
    names = sorted(str(path) for path in Path("/dev/serial/by-id").glob("*"))
    return ", ".join(names) if names else "/dev/serial/by-id/... (now empty: no serial device is plugged in)"


def _loss(error: Exception) -> str:
    if isinstance(error, serial.SerialTimeoutException):
        return "the device does not take what is sent to it"
    if isinstance(error, TypeError) or "not open" in str(error):
        return "closed"
    return f"lost ({error}); unplugged or powered off"
