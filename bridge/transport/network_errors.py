"""Messages to the user that explain network errors and advise what to do."""

import errno
import socket

from bridge.reasons.codes import Code, Sentence


def cause(error: OSError, place: str) -> Sentence:
    """Return the reason why a connection could not be made, or a local port could not be opened, with advice.

    error: raised by the attempt. place: the device's address, for the text.
    """
    if isinstance(error, socket.gaierror):
        return Code.NAME_UNKNOWN(place=place)
    if isinstance(error, TimeoutError):
        return Code.NO_ANSWER(place=place)
    match error.errno:
        case errno.ECONNREFUSED:
            return Code.CONNECTION_REFUSED(place=place)
        case errno.EHOSTUNREACH | errno.ENETUNREACH | errno.EHOSTDOWN | errno.ENETDOWN:
            return Code.UNREACHABLE(place=place)
        case errno.EADDRINUSE:
            return Code.LISTENING_BUSY(place=place)
        case errno.EADDRNOTAVAIL:
            return Code.ADDRESS_FOREIGN(place=place)
        case errno.EACCES | errno.EPERM:
            return Code.PORT_PRIVILEGED(place=place)
        case errno.EMFILE | errno.ENFILE:
            return Code.TOO_MANY_FILES(place=place)
    return Code.PLACE_FAILED(place=place, error=error.strerror or error)


def loss(error: OSError, place: str) -> Sentence:
    """Return the reason why an open network connection was lost.

    error: raised by the connection. place: the device's address, for the text.
    """
    if isinstance(error, TimeoutError) or error.errno == errno.ETIMEDOUT:
        return Code.CONNECTION_SILENT(place=place)
    return Code.CONNECTION_LOST(place=place, error=error.strerror or error)
