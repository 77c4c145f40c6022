"""Whether the service keeps up with its devices: how busy its loop is, and how long what came in waits. Pure."""

import logging
from collections.abc import Iterable

from bridge.wire.messages import Status
from bridge.wording import count
from estimator.service.shedding import WHY

log = logging.getLogger(__name__)

#: in the events of every device while it is so, and of the ward for ever: for how many seconds
OVERLOADED = "estimator overloaded"
#: so while its store cannot be written
UNKEPT = "store does not work"
#: busier than this share of the time, or with messages that wait for so long, ...
BUSY, WAITED_S = 0.95, 1.0
#: ... for so long without a break: then it does not keep up; and it does again after so long
PERSISTS_S, OVER_S = 5.0, 10.0
_DO = "give it fewer devices or a lower rate, a faster machine, or a second estimator for a part of them"


class Overload:
    """Told how long the loop idled, looked at once a second; times are of a steady clock."""

    def __init__(self, now: float) -> None:
        self._looked = now
        self._idle_s = 0.0
        self._overflowed = 0
        self._pressed: float | None = None  # since when
        self._last = float("-inf")  # when it was overloaded last
        self._began: float | None = None
        #: the busy share of the time between the last two looks
        self.ratio = 0.0
        #: how long it has not kept up by now, in whole seconds and at least one; 0 when it does
        self.seconds = 0

    def idle(self, seconds: float) -> None:
        """The loop had nothing to do for so long."""
        self._idle_s += seconds

    def look(self, now: float, *, overflowed: int, waited_s: float, shedding: bool = False) -> float:
        """How long it did not keep up since the last look, s.

        overflowed: messages that were dropped unread, in all; waited_s: how long the oldest that is there has waited;
        shedding: whether some devices are left out, or not learnt from.
        """
        passed_s, begin, self._looked = now - self._looked, self._looked, now
        if passed_s <= 0:
            return 0.0
        self.ratio = min(max(1.0 - self._idle_s / passed_s, 0.0), 1.0)
        self._idle_s = 0.0
        lost, self._overflowed = overflowed - self._overflowed, overflowed
        if not (self.ratio > BUSY or waited_s > WAITED_S):
            self._pressed = None
        elif self._pressed is None:
            self._pressed = begin
        pressed = self._pressed is not None and now - self._pressed >= PERSISTS_S
        if not (pressed or lost or shedding):
            if self._began is not None and now - self._last >= OVER_S:
                self._began, self.seconds = None, 0
                log.info("it keeps up with its devices again")
            return 0.0
        if self._began is None:
            self._began = begin
            if self._last == float("-inf"):
                why = (
                    f"{lost} messages were dropped unread"
                    if lost
                    else f"its loop is busy {100 * self.ratio:.0f} % of the time"
                )
                log.warning("the estimator does not keep up with its devices, %s: %s (more is only counted)", why, _DO)
        self._last = now
        self.seconds = max(1, round(now - self._began))
        return passed_s


def found(statuses: Iterable[Status]) -> list[str]:
    """That the estimator does not keep up now, by what it says of its devices, and what to do."""
    said = list(statuses)
    seconds = max((status.events.get(OVERLOADED, 0) for status in said), default=0)
    shed = sum(status.reason.startswith(WHY) for status in said)
    out = f", {count(shed, 'device is', 'devices are')} left out" if shed else ""
    return [f"the estimator has not kept up with its devices for {seconds} s{out}: {_DO}"] if seconds else []


def unkept(statuses: Iterable[Status]) -> list[str]:
    """That an estimator cannot write its store now, by what it says of its devices."""
    devices = sum(UNKEPT in status.events for status in statuses)
    what = f"the store of {count(devices, 'device')} cannot be written: what is calibrated now is lost when its estimator ends"
    return [f"{what}; its log, and its /readyz, say why"] if devices else []
