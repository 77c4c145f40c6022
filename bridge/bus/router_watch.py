"""Router watch: logs the loss and the return of the router, and why the router may be away."""

import logging
from collections.abc import Iterable

from bridge.bus.routers import Routers

#: a router away for this long, s, is not just restarting
_LONG_S = 10.0
#: interval of the check whether the certificate expires soon, s
_SELDOM_S = 12 * 3600.0


class RouterWatch:
    """Logs the loss and the return of the router, and a certificate that expires soon.

    routers: endpoints and this program's certificate.
    """

    def __init__(self, log: logging.Logger, routers: Routers | None = None) -> None:
        self._log = log
        self._there = True
        self._routers = routers or Routers(())
        self._ask_s, self._explain_s = float("-inf"), float("inf")

    def look(self, now: float, *, connected: bool) -> bool:
        """Log a change of the connection. Return whether the router is away, or was away at the last call.

        now: seconds of a monotonic clock. connected: whether a router is connected now.
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
