"""Router watch: logs when the router is lost and when it returns, and why it may be unreachable."""

import logging
import socket
from collections.abc import Iterable

from bridge.bus.routers import Routers
from bridge.runtime import os_errors

_WAIT_S = 1.0
_OVER_TCP = ("tcp", "tls", "ws")
#: a router away for this long, s, is not just restarting
_LONG_S = 10.0
#: interval of the check whether the certificate expires soon, s
_SELDOM_S = 12 * 3600.0


class RouterWatch:
    """Logs the loss and the return of the router, and warns when this program's certificate expires soon.

    routers: router endpoints and this program's certificate. log: logger to write to.
    """

    def __init__(self, log: logging.Logger, routers: Routers | None = None) -> None:
        self._log = log
        self._there = True
        self._routers = routers or Routers(())
        self._ask_s, self._explain_s = float("-inf"), float("inf")

    def look(self, now: float, *, connected: bool) -> bool:
        """Log a loss or a return of the router. Return True if it is absent now or was absent at the previous call.

        now: seconds of a monotonic clock. connected: True if a router is connected now.
        """
        if now >= self._ask_s:
            self._ask_s = now + _SELDOM_S
            self._warn(self._routers.soon())
        away = not (connected and self._there)
        if connected != self._there:
            self._there = connected
            self._explain_s = float("inf") if connected else now + _LONG_S
            if connected:
                self._log.info("the router is connected again")
            else:
                self._log.warning("the router is gone; waiting for it to return")
        if now >= self._explain_s:
            self._explain_s = float("inf")
            self._warn(f"no router for {_LONG_S:.0f} s: {words}" for words in self._routers.why_away())
        return away

    def _warn(self, said: Iterable[str]) -> None:
        for words in said:
            self._log.warning("%s", words)


def why_unreachable(endpoint: str) -> str:
    """Test a router endpoint (`tcp/10.0.0.1:7447`) by a TCP connection; return in words why it is unreachable.

    Waits at most 1 s. Returns "" if a TCP connection opens, or if the protocol of the endpoint does not use TCP.
    If TCP works although zenoh does not, the router may refuse the zenoh session.
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
