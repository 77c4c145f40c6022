"""Sentences for people on network errors, with what to do."""

import errno
import socket

from bridge.reasons.codes import Code, Sentence


def cause(error: OSError, place: str) -> Sentence:
    """Return a sentence on why a connection could not be made, or why a port could not be opened for listening.

    error: raised by the attempt. place: the address, for the sentence.
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
    """Return a sentence on why an open network connection was lost.

    error: raised by the connection. place: the address, for the sentence.
    """
    if isinstance(error, TimeoutError) or error.errno == errno.ETIMEDOUT:
        return Code.CONNECTION_SILENT(place=place)
    return Code.CONNECTION_LOST(place=place, error=error.strerror or error)
