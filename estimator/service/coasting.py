"""More than can be done, and less can be done for each: devices whose bias is known go on for a while without learning. Pure.

To learn takes a third of all that a device's samples take; to predict a bias for a minute costs next to nothing of what is known
of it. So nothing is lost, and nobody left out (see shedding.py), as long as that is enough. Those that have learnt longest coast,
in turn: each learns for long enough to find a rest.
"""

import logging
import math
from collections.abc import Callable, Collection, Iterator

log = logging.getLogger(__name__)

#: what waits for so long, s, and not for less after so long, ...
WAITED_S, PATIENCE_S = 0.5, 2.0
#: ... lets so much more of all that may coast do so, all but a few where it is as old as that, s
STEP, MOST, OLD_S = 0.25, 0.9, 2.0
#: one that begins to learn does so for so long, s
LEARNS_S = 10.0
#: who is looked at after so long was stopped, which tells nothing of what it can do
STALLED_S = 3.0
#: less of them coast where the loop was no busier than this for so long, s; twice as long each time that it was too early
BUSY, CALM_S, MOST_CALM_S, SOON_S = 0.85, 10.0, 640.0, 60.0
#: by this share
BACK = 0.1


class Coasting:
    """Told about once a second, by a steady clock, s, how it goes; a container of the names of those that coast.

    able: those that may.
    """

    def __init__(self, able: Callable[[], Collection[str]]) -> None:
        self._able = able
        #: how much of those that may are to coast
        self.share = 0.0
        self._coast = dict[str, None]()  # the first of them for longest
        self._learn = dict[str, float]()  # the others that may, and since when; the first for longest
        self._looked = self._eased = float("-inf")
        self._waited: tuple[float, float] | None = None  # for how long what waits did, and when that was
        self._calm_s, self._since, self._busy_s = CALM_S, float("-inf"), 0.0

    def __len__(self) -> int:
        return len(self._coast)

    def __contains__(self, device: str) -> bool:
        return device in self._coast

    def __iter__(self) -> Iterator[str]:
        return iter(self._coast)

    def look(self, now: float, *, waited_s: float, busy: float, shedding: bool) -> None:
        """waited_s: for how long the oldest that is there has waited; busy: the loop, 0 to 1; shedding: some are left out."""
        passed_s, self._looked = now - self._looked, now
        if passed_s > STALLED_S:
            self._waited, self._since, self._busy_s = None, now, 0.0
        elif waited_s > WAITED_S:
            self._press(now, waited_s)
        else:
            self._waited = None
            self._ease(now, busy * passed_s, shedding=shedding)
        if self.share or self._coast:
            self._take_turns(now, self._able())

    def _press(self, now: float, waited_s: float) -> None:
        self._since, self._busy_s = now, 0.0
        if self._waited is None or waited_s < self._waited[0]:
            self._waited = waited_s, now
        elif now - self._waited[1] >= PATIENCE_S and self.share < MOST and self._able():
            if now - self._eased < SOON_S:
                self._calm_s, self._eased = min(2 * self._calm_s, MOST_CALM_S), float("-inf")
            if not self.share:
                log.warning(
                    "too much comes for this estimator to learn from all of it: the bias of devices whose bias is known is"
                    " only predicted for a while, in turn, until there is time again"
                )
            more = MOST if waited_s > OLD_S else STEP
            self.share, self._waited = min(self.share + more, MOST), (waited_s, now)

    def _ease(self, now: float, busy_s: float, *, shedding: bool) -> None:
        self._busy_s += busy_s
        if not self.share or shedding:
            self._since, self._busy_s = now, 0.0
        if not self.share or now - self._since < self._calm_s:
            return
        if self._busy_s / (now - self._since) <= BUSY:
            self.share, self._eased = max(self.share - BACK, 0.0), now
            if self.share < BACK:
                self.share, self._calm_s = 0.0, CALM_S
                log.info("there is time again to learn from all devices")
        self._since, self._busy_s = now, 0.0

    def _take_turns(self, now: float, able: Collection[str]) -> None:
        may = set(able)
        self._coast = {name: None for name in self._coast if name in may}
        self._learn = {name: since for name, since in self._learn.items() if name in may}
        self._learn |= {name: now for name in able if name not in self._coast and name not in self._learn}
        most = math.ceil(self.share * len(may))
        # Who has learnt for long enough changes places with who has coasted longest.
        long = [name for name, since in self._learn.items() if now - since >= LEARNS_S]
        back = list(self._coast)[: max(len(self._coast) - most, min(len(long), len(self._coast)))]
        for name in back:
            del self._coast[name]
            self._learn[name] = now
        for name in list(self._learn)[: max(0, most - len(self._coast))]:
            del self._learn[name]
            self._coast[name] = None
