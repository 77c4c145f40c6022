"""What waits for a quiet moment, so that no sample waits for it: learning, and looking after each device once a second.

Nothing waits for ever: a session learns at the latest where it needs to know, at the end of its next half second, and of those
who were not looked after for a second some are in every round: for four thousand at once samples would wait for seconds.
"""

import time
from collections.abc import Callable
from enum import IntEnum, auto

#: for so long at a time, s: then there are other things to be seen to
AT_ONCE_S = 0.02


class Kind(IntEnum):
    """What is to be done, the first first. A calibration takes as long as twenty half seconds without one."""

    LEARN = 0
    LOOK = auto()
    NOTE = auto()
    CALIBRATE = auto()


class Quiet:
    """One piece of work of a kind for each name; `busy` tells whether samples wait."""

    def __init__(self, busy: Callable[[], bool], clock: Callable[[], float] = time.monotonic) -> None:
        self._busy, self._clock = busy, clock
        self._due: list[dict[str, Callable[[], object]]] = [{} for _ in Kind]
        self._late = [0 for _ in Kind]  # how many of them, the first, wait for no quiet moment any more

    def __bool__(self) -> bool:
        return any(self._due)

    def add(self, kind: Kind, name: str, work: Callable[[], object]) -> None:
        """It is to be done; instead of what is to be done already."""
        self._due[kind][name] = work

    def hurry(self, kind: Kind) -> None:
        """What there is of a kind is late: some of it is done in every round, whether samples wait or not."""
        self._late[kind] = len(self._due[kind])

    def work(self) -> None:
        """Do one after the other until a sample comes, or for as long as that may take."""
        until = self._clock() + AT_ONCE_S
        for kind in Kind:
            while self._due[kind] and (self._late[kind] or not self._busy()) and self._clock() < until:
                self._do(kind)

    def finish(self, *kinds: Kind) -> None:
        """Do all there is, of some kinds or of all."""
        for kind in kinds or Kind:
            while self._due[kind]:
                self._do(kind)

    def _do(self, kind: Kind) -> None:
        due = self._due[kind]
        self._late[kind] = max(0, self._late[kind] - 1)
        due.pop(next(iter(due)))()
