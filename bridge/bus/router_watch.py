"""Router watch: logs the loss and the return of the router, and why the router may be away."""

import logging
from collections.abc import Iterable

from bridge.bus.routers import Routers

_HELD_UP_S = 0.5
_LATELY_S = 5.0
#: a router away for this long, s, is not just restarting
_LONG_S = 10.0
#: interval of the check whether the certificate expires soon, s
_SELDOM_S = 12 * 3600.0


class RouterWatch:
    """Logs the loss and the return of the router, and a certificate that expires soon.

    Call `look` every every_s seconds of a monotonic clock. routers: endpoints and this program's certificate.
    """

    def __init__(self, log: logging.Logger, every_s: float, routers: Routers | None = None) -> None:
        self._log, self._every_s = log, every_s
        self._there = True
        self._looked_s: float | None = None
        self._held_s, self._held_at_s = 0.0, float("-inf")
        self._routers = routers or Routers(())
        self._ask_s, self._explain_s = float("-inf"), float("inf")

    def look(self, now: float, *, connected: bool) -> bool:
        """Log a change of the connection. Return whether the router is away, or was away at the last call.

        now: seconds of a monotonic clock. connected: whether a router is connected now.
        """
        if self._looked_s is not None and (held_s := now - self._looked_s - self._every_s) > _HELD_UP_S:
            self._held_s, self._held_at_s = held_s, now
        self._looked_s = now
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
                self._log.warning("the router is gone%s; waiting for it to return", self._or_not(now))
        if now >= self._explain_s:
            self._explain_s = float("inf")
            self._warn(f"no router for {_LONG_S:.0f} s: {words}" for words in self._routers.why_away())
        return away

    def _warn(self, said: Iterable[str]) -> None:
        for words in said:
            self._log.warning("%s", words)

    def _or_not(self, now: float) -> str:
        if now - self._held_at_s > _LATELY_S:
            return ""
        return f", or this program was stopped for {self._held_s:.1f} s because the machine is too busy"
