"""Learning waits for a quiet moment, so that no sample waits for it: half seconds of all devices, one after the other.

Where there is none, a session learns at the end of the next half second, just before it is needed.
"""

import time
from collections.abc import Callable

from estimator.service.device import Device

#: for so long at a time, s: then there are other things to be seen to
AT_ONCE_S = 0.02


class Lessons:
    """Devices with a lesson in, `learn` called for each; `busy` tells whether samples wait."""

    def __init__(
        self, learn: Callable[[Device], None], busy: Callable[[], bool], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._learn, self._busy, self._clock = learn, busy, clock
        self._due: dict[str, Device] = {}

    def __bool__(self) -> bool:
        return bool(self._due)

    def add(self, device: Device) -> None:
        """It has a lesson to learn."""
        self._due[device.name] = device

    def work(self) -> None:
        """Learn until a sample comes, or for as long as that may take."""
        until = self._clock() + AT_ONCE_S
        while self._due and not self._busy() and self._clock() < until:
            self._next()

    def finish(self) -> None:
        """Learn all there is."""
        while self._due:
            self._next()

    def _next(self) -> None:
        device = self._due.pop(next(iter(self._due)))
        if device.session.to_learn:
            self._learn(device)
