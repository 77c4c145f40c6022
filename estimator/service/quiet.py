"""What waits for a quiet moment, so that no sample waits for it: learning, and looking after each device once a second.

Nothing waits for ever: a session learns at the latest where it needs to know, at the end of its next block, and who was
not looked after for a second is looked after then.
"""

import time
from collections.abc import Callable
from enum import IntEnum, auto

#: for so long at a time, s: then there are other things to be seen to
AT_ONCE_S = 0.02


class Kind(IntEnum):
    """What is to be done, the first first. A calibration takes as long as ten seconds without one."""

    LEARN = 0
    LOOK = auto()
    CALIBRATE = auto()


class Quiet:
    """One piece of work of a kind for each name; `busy` tells whether samples wait."""

    def __init__(self, busy: Callable[[], bool], clock: Callable[[], float] = time.monotonic) -> None:
        self._busy, self._clock = busy, clock
        self._due: list[dict[str, Callable[[], object]]] = [{} for _ in Kind]

    def __bool__(self) -> bool:
        return any(self._due)

    def add(self, kind: Kind, name: str, work: Callable[[], object]) -> None:
        """It is to be done; instead of what is to be done already."""
        self._due[kind][name] = work

    def work(self) -> None:
        """Do one after the other until a sample comes, or for as long as that may take."""
        until = self._clock() + AT_ONCE_S
        for due in self._due:
            while due and not self._busy() and self._clock() < until:
                _next(due)

    def finish(self, *kinds: Kind) -> None:
        """Do all there is, of some kinds or of all."""
        for kind in kinds or Kind:
            while due := self._due[kind]:
                _next(due)


def _next(due: dict[str, Callable[[], object]]) -> None:
    due.pop(next(iter(due)))()
