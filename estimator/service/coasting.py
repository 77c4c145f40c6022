"""More than can be done, and less can be done for each: devices whose bias is known go on for a while without learning. Pure.

To learn takes a third of all that a device's samples take; to predict a bias for some minutes costs little of what is known of
it. So nothing is lost, and nobody left out (see shedding.py), as long as that is enough. Those that have learnt longest coast,
in turn: each learns for long enough to find a rest, or to lie and breathe for a stretch (track/bounded.py).
"""

import logging
from collections.abc import Callable, Collection, Iterator

log = logging.getLogger(__name__)

#: where what waits has waited for so long, s, and has become no less in so long, ...
WAITED_S, PATIENCE_S = 0.5, 2.0
#: ... so much more of all that may coast do so; all but a few where it is as old as that, s
STEP, MOST, OLD_S = 0.25, 0.9, 2.0
#: one that begins to learn does so for so long, s, unless more have to coast
LEARNS_S = 60.0
#: who is looked at after so long was stopped, which tells nothing of what it can do
STALLED_S = 3.0
#: this much less of them coast where the loop was no busier than that for so long, s; twice as long each time it was too early
BACK, BUSY, CALM_S, MOST_CALM_S, SOON_S = 0.1, 0.95, 10.0, 640.0, 60.0
#: and none where it would not be much busier then: by how much less the loop is busy with one that coasts, about
SPARED, AT_EASE = 0.3, 0.85


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
        self._least: tuple[int, float] | None = None  # messages that waited, of those that were too old, and when
        self._calm_s, self._since, self._busy_s = CALM_S, float("-inf"), 0.0

    def __len__(self) -> int:
        return len(self._coast)

    def __contains__(self, device: str) -> bool:
        return device in self._coast

    def __iter__(self) -> Iterator[str]:
        return iter(self._coast)

    def look(self, now: float, *, waiting: int, waited_s: float, busy: float, shedding: bool) -> None:
        """Messages that are there, and for how long the oldest has been; busy: the loop, 0 to 1.

        shedding: whether some devices are left out for want of room.
        """
        passed_s, self._looked = now - self._looked, now
        if passed_s > STALLED_S:
            self._least = None
            self._watch(now)
        elif waited_s > WAITED_S:
            self._press(now, waiting, waited_s)
        else:
            self._least = None
            self._ease(now, busy * passed_s, shedding=shedding)
        if self.share or self._coast:
            self._take_turns(now, self._able())

    def _watch(self, now: float) -> None:
        """How busy it is, from now on."""
        self._since, self._busy_s = now, 0.0

    def _press(self, now: float, waiting: int, waited_s: float) -> None:
        self._watch(now)
        if self._least is None or waiting < self._least[0]:
            self._least = waiting, now
        elif now - self._least[1] >= PATIENCE_S and self.share < MOST and self._able():
            if now - self._eased < SOON_S:
                self._calm_s, self._eased = min(2 * self._calm_s, MOST_CALM_S), float("-inf")
            elif not self.share:
                self._calm_s = CALM_S
            if not self.share:
                log.warning(
                    "too much comes for this estimator to learn from all of it: the bias of devices whose bias is known is"
                    " only predicted for a while, in turn, until there is time again"
                )
            more = MOST if waited_s > OLD_S else STEP
            self.share, self._least = min(self.share + more, MOST), (waiting, now)

    def _ease(self, now: float, busy_s: float, *, shedding: bool) -> None:
        self._busy_s += busy_s
        if not self.share or shedding:
            self._watch(now)
        elif now - self._since >= self._calm_s:
            busy = self._busy_s / (now - self._since)
            self._watch(now)
            if busy <= BUSY:
                at_ease = busy <= AT_EASE * (1 - SPARED * self.share)
                self.share, self._eased = 0.0 if at_ease else self.share - BACK, now
            if self.share < BACK / 2:
                self.share = 0.0
                log.info("there is time again to learn from all devices")

    def _take_turns(self, now: float, able: Collection[str]) -> None:
        may = set(able)
        self._coast = {name: None for name in self._coast if name in may}
        self._learn = {name: since for name, since in self._learn.items() if name in may}
        self._learn |= {name: now for name in able if name not in self._coast and name not in self._learn}
        most = int(self.share * len(may) + 1e-9)
        # Who has learnt for long enough changes places with who has coasted longest.
        enough = sum(now - since >= LEARNS_S for since in self._learn.values())
        for name in list(self._coast)[: max(len(self._coast) - most, min(enough, len(self._coast)))]:
            del self._coast[name]
            self._learn[name] = now
        for name in list(self._learn)[: max(0, most - len(self._coast))]:
            del self._learn[name]
            self._coast[name] = None
