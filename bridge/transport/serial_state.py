"""Whether a serial port can be opened, and why it could not be: in words, with what to do."""

import errno
import os
import stat

from bridge.transport.holders import holders, is_bridge, locked

MISSING = "missing; plug the device in, or look for the name of its port with `truerate bridge scan`"
FORBIDDEN = "no permission; add the user to group dialout (sudo usermod -aG dialout $USER) and log in again"
NO_PORT = "not a serial port"
_MISSING = frozenset({errno.ENOENT, errno.ENODEV, errno.ENXIO})
_FORBIDDEN = frozenset({errno.EACCES, errno.EPERM})
_BUSY = frozenset({errno.EBUSY, errno.EAGAIN})
_NO_PORT = frozenset({errno.ENOTTY, errno.EINVAL, errno.EISDIR})
_MEMORY_DEVICES = 1  # the major number of /dev/null and its kind


def state(port: str) -> str:
    """Whether a port could be opened now. It is not opened for that, which would boot some boards."""
    try:
        status = os.stat(port)  # noqa: PTH116 - a name, as everywhere here
    except OSError as error:
        return cause(error, port)
    if _no_port(status):
        return NO_PORT
    if not os.access(port, os.R_OK | os.W_OK):
        return FORBIDDEN
    return busy(port) if locked(port) else "present"


def no_port(port: str) -> bool:
    """Whether something is there that cannot be a serial port: a file, a folder, /dev/null."""
    try:
        return _no_port(os.stat(port))  # noqa: PTH116 - a name, as everywhere here
    except OSError:
        return False


def cause(error: Exception, port: str) -> str:
    """Why a port cannot be opened, by what opening it said."""
    number = _number(error)
    if number in _MISSING:
        return MISSING
    if number in _FORBIDDEN:
        return FORBIDDEN
    if number in _BUSY:
        return busy(port)
    if number in _NO_PORT or "configure port" in str(error):
        return NO_PORT
    return str(error)


def settling(error: Exception) -> bool:
    """Whether it may be a port that was just plugged in, whose name and permissions are not settled."""
    return _number(error) in _MISSING | _FORBIDDEN | {errno.EIO}


def busy(port: str) -> str:
    """Who has it open, as far as we may know."""
    having = holders(port)
    if having and all(is_bridge(holder.pid) for holder in having):
        bridges = ", ".join(f"process {holder.pid}" for holder in having)
        return f"busy; a bridge ({bridges}) reads it" if len(having) == 1 else f"busy; bridges ({bridges}) read it"
    who = ", ".join(map(str, having)) or "another program"
    return f"busy; {who} " + ("have it open: close those" if len(having) > 1 else "has it open: close that one")


def _no_port(status: os.stat_result) -> bool:
    return not stat.S_ISCHR(status.st_mode) or os.major(status.st_rdev) == _MEMORY_DEVICES


def _number(error: Exception) -> int | None:
    number = error.errno if isinstance(error, OSError) else (error.args or [None])[0]
    return number if isinstance(number, int) else None
