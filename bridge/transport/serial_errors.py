"""Sentences for people on why a serial port cannot be opened, with what to do."""

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
    """Return a serial port's state in words, without opening the port; `present` if it could be opened now."""
    said = fault(port)
    return english(said) if said is not None else "present"


def fault(port: str) -> Sentence | None:
    """Return a sentence on why a serial port could not be opened now, with what to do; None if it could be.

    The port is not opened, because opening boots some boards.
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
    """Return a sentence on why a serial port could not be opened, with what to do.

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
    """Return True if an error of opening a port may pass by itself, because the port was just plugged in.

    The port's name and permissions may then still be about to change.
    """
    return _number(error) in _MISSING | _FORBIDDEN | {errno.EIO}


def busy(port: str) -> Sentence:
    """Return a sentence that names the visible processes that have the serial port open."""
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
