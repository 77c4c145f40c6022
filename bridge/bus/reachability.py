"""Why no router answers at an endpoint, as far as TCP can tell."""

import socket

from bridge.runtime import os_errors

_WAIT_S = 1.0
_OVER_TCP = ("tcp", "tls", "ws")


def why_unreachable(endpoint: str) -> str:
    """A few words; empty where a connection opens, so that what is there does not want ours, or where that cannot be tried."""
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.partition("#")[0].partition("?")[0].rpartition(":")
    if protocol not in _OVER_TCP or not port.isdecimal():
        return ""
    try:
        socket.create_connection((host.removeprefix("[").removesuffix("]"), int(port)), _WAIT_S).close()
    except socket.gaierror:
        return f"nobody knows the name {host}"
    except ConnectionRefusedError:
        return "nothing listens there"
    except TimeoutError:
        return "no sign of that machine"
    except OSError as error:
        return os_errors.why(error)
    return ""
