"""What waits for a quiet moment, so that no sample waits for it: learning, and looking after each device once a second.

Nothing waits for ever: a session learns at the latest where it needs to know, at the end of its next block, and who was
not looked after for a second is looked after soon, some in every round whatever waits.
"""

import time
from collections.abc import Callable
from enum import IntEnum, auto
from typing import NamedTuple

#: for so long at a time, s: then there are other things to be seen to
AT_ONCE_S = 0.02
#: what has been due for so long is late, s; and has at least so long in every round, s, or a part of the time since the last one
LATE_AFTER_S = 1.0
LATE_S, LATE_PART = 0.002, 0.2


class Kind(IntEnum):
    """What is to be done, the first first. A calibration takes as long as ten seconds without one."""

    LEARN = 0
    LOOK = auto()
    CALIBRATE = auto()


class _Due(NamedTuple):
    """Work, and since when it is to be done."""

    work: Callable[[], object]
    since: float


class Quiet:
    """One piece of work of a kind for each name; `busy` tells whether samples wait."""

    def __init__(self, busy: Callable[[], bool], clock: Callable[[], float] = time.monotonic) -> None:
        self._busy, self._clock = busy, clock
        self._due: list[dict[str, _Due]] = [{} for _ in Kind]
        self._worked = clock()

    def __bool__(self) -> bool:
        return any(self._due)

    def add(self, kind: Kind, name: str, work: Callable[[], object]) -> None:
        """It is to be done; instead of what is to be done already, and as soon as that."""
        due = self._due[kind]
        before = due.get(name)
        due[name] = _Due(work, self._clock() if before is None else before.since)

    def work(self) -> None:
        """Do one after the other until a sample comes, or for as long as that may take; some looks that are late in any case."""
        now, look = self._clock(), self._due[Kind.LOOK]
        late_until = now + min(max(LATE_S, LATE_PART * (now - self._worked)), AT_ONCE_S)
        while look and next(iter(look.values())).since <= now - LATE_AFTER_S and self._clock() < late_until:
            _next(look)
        for due in self._due:
            while due and not self._busy() and self._clock() < now + AT_ONCE_S:
                _next(due)
        self._worked = self._clock()

    def finish(self) -> None:
        """Do all there is."""
        for due in self._due:
            while due:
                _next(due)


def _next(due: dict[str, _Due]) -> None:
    due.pop(next(iter(due))).work()
