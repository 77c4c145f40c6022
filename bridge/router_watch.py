"""Whether a router is there: said when it changes, and whether this program itself was held up, which may be why. Pure."""

import logging

_HELD_UP_S = 0.5
_LATELY_S = 5.0


class RouterWatch:
    """To be looked at every_s seconds; times are of a steady clock."""

    def __init__(self, log: logging.Logger, every_s: float) -> None:
        self._log, self._every_s = log, every_s
        self._there = True
        self._looked_s: float | None = None
        self._held_s, self._held_at_s = 0.0, float("-inf")

    def look(self, now: float, *, connected: bool) -> bool:
        """Say what is new; whether it was, or is, away since the last look."""
        if self._looked_s is not None and (held_s := now - self._looked_s - self._every_s) > _HELD_UP_S:
            self._held_s, self._held_at_s = held_s, now
        self._looked_s = now
        away = not (connected and self._there)
        if connected != self._there:
            self._there = connected
            if connected:
                self._log.info("the router is back")
            else:
                self._log.warning("the router is gone%s; going on, and waiting for it", self._or_not(now))
        return away

    def _or_not(self, now: float) -> str:
        if now - self._held_at_s > _LATELY_S:
            return ""
        return f", or was not heard: this program was held up for {self._held_s:.1f} s, the machine is too busy"
