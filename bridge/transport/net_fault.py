"""What the network's faults mean, in words, with what to do."""

import errno
import socket


def cause(error: OSError, place: str) -> str:
    """Why a connection cannot be made, or a port not be listened on."""
    return f"{place}: {_cause(error)}"


def _cause(error: OSError) -> str:
    if isinstance(error, socket.gaierror):
        return "this name is not known; check its spelling, or give the address in numbers"
    if isinstance(error, TimeoutError):
        return "no answer; is the device on, and in this network?"
    match error.errno:
        case errno.ECONNREFUSED:
            return (
                "refused; the machine is there, but nothing listens on this port: is the device ready, the port right?"
            )
        case errno.EHOSTUNREACH | errno.ENETUNREACH | errno.EHOSTDOWN | errno.ENETDOWN:
            return "unreachable; is the device on, and in this network?"
        case errno.EADDRINUSE:
            return "busy; another program listens on this port: close that one, or choose another port"
        case errno.EADDRNOTAVAIL:
            return "this machine has no such address; listen on one of its own, or leave it out for all of them"
        case errno.EACCES | errno.EPERM:
            return "no permission; choose a port above 1023"
        case errno.EMFILE | errno.ENFILE:
            return "too many open files; raise the limit (ulimit -n)"
    return error.strerror or str(error)


def loss(error: OSError, place: str) -> str:
    """Why an open connection was lost."""
    if isinstance(error, TimeoutError) or error.errno == errno.ETIMEDOUT:
        return f"{place}: lost; the device no longer answers: powered off, or out of reach"
    return f"{place}: lost ({error.strerror or error}); powered off, or out of reach"
