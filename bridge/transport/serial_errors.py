"""Messages to the user that explain why a serial port cannot be opened and advise what to do."""

import errno
import os
import stat

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code, Sentence
from bridge.transport.port_holders import holders, is_bridge, locked

_MISSING = frozenset({errno.ENOENT, errno.ENODEV, errno.ENXIO})
_FORBIDDEN = frozenset({errno.EACCES, errno.EPERM})
_BUSY = frozenset({errno.EBUSY, errno.EAGAIN})
_NO_PORT = frozenset({errno.ENOTTY, errno.EINVAL, errno.EISDIR})
_MEMORY_DEVICES = 1  # major number of /dev/null and similar devices


def state(port: str) -> str:
    """Return `present` if a serial port could be opened now, else the cause in words. Does not open the port."""
    said = fault(port)
    return english(said) if said is not None else "present"


def fault(port: str) -> Sentence | None:
    """Return the reason why a serial port cannot be opened now, with advice; None if it can be opened.

    The port is not opened for this check, because opening restarts some boards. port: path of the port.
    """
    try:
        status = os.stat(port)  # noqa: PTH116 - a name, as everywhere in this file
    except OSError as error:
        return cause(error, port)
    if _no_port(status):
        return Code.NOT_A_SERIAL_PORT(place=port)
    if not os.access(port, os.R_OK | os.W_OK):
        return Code.PORT_FORBIDDEN(place=port)
    others = any(holder.pid != os.getpid() for holder in holders(port))
    return busy(port) if others or locked(port) else None


def no_port(port: str) -> bool:
    """Return True if the path leads to something other than a serial port: a file, a folder, /dev/null.

    False if there is no such path.
    """
    try:
        return _no_port(os.stat(port))  # noqa: PTH116 - a name, as everywhere in this file
    except OSError:
        return False


def cause(error: Exception, port: str) -> Sentence:
    """Return the reason why an attempt to open a serial port failed, with advice.

    error: raised by the attempt. port: path of the port.
    """
    number = _number(error)
    if number in _MISSING:
        return Code.PORT_MISSING(place=port)
    if number in _FORBIDDEN:
        return Code.PORT_FORBIDDEN(place=port)
    if number in _BUSY:
        return busy(port)
    if number in _NO_PORT or "configure port" in str(error):
        return Code.NOT_A_SERIAL_PORT(place=port)
    return Code.PLACE_FAILED(place=port, error=error)


def settling(error: Exception) -> bool:
    """Return True if opening a port may succeed a moment later, because the device has only just been plugged in.

    The system may then still have to set the port's name and permissions. error: raised by opening the port.
    """
    return _number(error) in _MISSING | _FORBIDDEN | {errno.EIO}


def busy(port: str) -> Sentence:
    """Return the reason that other processes have a serial port open; it names those that this user may see."""
    having = holders(port)
    if not having:
        return Code.PORT_BUSY(place=port)
    bridges = all(is_bridge(holder.pid) for holder in having)
    return (Code.PORT_READ_BY_BRIDGE if bridges else Code.PORT_HELD)(place=port, holders=", ".join(map(str, having)))


def _no_port(status: os.stat_result) -> bool:
    return not stat.S_ISCHR(status.st_mode) or os.major(status.st_rdev) == _MEMORY_DEVICES


def _number(error: Exception) -> int | None:
    number = error.errno if isinstance(error, OSError) else (error.args or [None])[0]
    return number if isinstance(number, int) else None
