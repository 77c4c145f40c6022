"""Overload detection: measures which share of the time the estimator's loop is busy. Pure."""

import logging
from collections.abc import Iterable

from bridge.reasons.codes import Code, Sentence
from bridge.wire.messages import Status

log = logging.getLogger(__name__)

#: event of every device while the estimator is overloaded, with the seconds; remains in the ward's counts
OVERLOADED = "estimator overloaded"
#: event of every device while the store cannot be written
UNKEPT = "store does not work"
#: overloaded when the loop is busier than this share of the time ...
BUSY = 0.95
#: ... without a break for the first number of seconds; recovered after the second number of seconds
PERSISTS_S, OVER_S = 5.0, 10.0
_DO = "use fewer devices, a lower rate, a faster machine, or a second estimator in the ward"


class Overload:
    """Overload detector of the run loop: `idle` adds idle time, `look` checks once a second.

    now: monotonic time, s. `busy`: busy share of the time between the last two checks, 0 to 1.
    """

    def __init__(self, now: float) -> None:
        self._looked, self._idle_s = now, 0.0
        self._calm = self._last = now  # when it last kept up, and when it last did not
        self._began: float | None = None
        #: busy share of the time between the last two checks
        self.busy = 0.0

    def idle(self, seconds: float) -> None:
        """Add time in which the loop had nothing to do.

        seconds: this time, s.
        """
        self._idle_s += seconds

    def look(self, now: float) -> int:
        """Check whether the loop keeps up; return the length of the present overload in s, 0 without an overload.

        now: monotonic time, s. Call it once a second.
        An overload begins when the busy share has been above BUSY (0.95) for PERSISTS_S (5) seconds. It ends OVER_S
        (10) seconds after this condition last held.
        """
        passed_s, self._looked = now - self._looked, now
        if passed_s > 0:
            self.busy = min(max(1.0 - self._idle_s / passed_s, 0.0), 1.0)
        self._idle_s = 0.0
        if self.busy <= BUSY:
            self._calm = now
        if now - self._calm >= PERSISTS_S:
            if self._began is None:
                self._began = now - passed_s
                log.warning(
                    "the estimator is overloaded, its loop is busy %.0f %% of the time: %s",
                    100 * self.busy,
                    _DO,
                )
            self._last = now
        elif self._began is not None and now - self._last >= OVER_S:
            self._began = None
            log.info("the estimator keeps up with its devices again")
        return 0 if self._began is None else max(1, round(now - self._began))


def found(statuses: Iterable[Status]) -> list[Sentence]:
    """Return the overload notice, with advice, as a list of one sentence; empty if no status reports an overload."""
    seconds = max((status.events.get(OVERLOADED, 0) for status in statuses), default=0)
    return [Code.ESTIMATOR_OVERLOADED(duration_s=seconds)] if seconds else []


def unkept(statuses: Iterable[Status]) -> list[Sentence]:
    """Return the notice that an estimator cannot write its store, as a list of one sentence.

    Empty if no status reports it.
    """
    devices = sum(UNKEPT in status.events for status in statuses)
    return [Code.STORE_FAILING(devices=devices)] if devices else []
