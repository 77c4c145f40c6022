"""Reachability of a router's endpoint, tested with a TCP connection."""

import socket

from bridge.runtime import os_errors

_WAIT_S = 1.0
_OVER_TCP = ("tcp", "tls", "ws")


def why_unreachable(endpoint: str) -> str:
    """Test a router endpoint (`tcp/10.0.0.1:7447`) by a TCP connection; return in words why it is unreachable.

    Waits 1 s at most. Empty if a TCP connection opens (the router then refuses zenoh's), or if the protocol does not
    run over TCP.
    """
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.partition("#")[0].partition("?")[0].rpartition(":")
    if protocol not in _OVER_TCP or not port.isdecimal():
        return ""
    try:
        socket.create_connection((host.removeprefix("[").removesuffix("]"), int(port)), _WAIT_S).close()
    except socket.gaierror:
        return f"the name {host} is unknown"
    except ConnectionRefusedError:
        return "no program listens there"
    except TimeoutError:
        return "the machine does not answer"
    except OSError as error:
        return os_errors.why(error)
    return ""
