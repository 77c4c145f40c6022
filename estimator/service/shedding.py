"""Load shedding, by whole devices: of more than can be done some whole are worth more than all in pieces. Pure.

While its queue is more than half full and becomes no shorter, devices are left out until what is left can be done. They come
back as soon as there is room for them.
"""

import logging
import math
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from itertools import islice

from bridge.bus.contract import Message
from bridge.wording import count
from estimator.service.turns import A_SECOND

log = logging.getLogger(__name__)

#: messages of devices that are left out are counted under this
SHED = "messages shed"
#: why a device is where it is, meanwhile
WHY = (
    "the estimator has more devices than it can handle: what this one sends is not looked at until there is room again"
)
#: a queue that is fuller than this share, and was never shorter for so long, ...
FILLED, PATIENCE_S = 0.5, 4.0
#: ... is one to which too much comes, as is one of which anything was dropped, and by this share more: what waits is to be done,
#: too. So much at once at most: it may be something else that takes our time
SPARE, MOST = 0.1, 0.25
#: who is looked at after so long was stopped, which tells nothing of what it can do
STALLED_S = 2.0
#: devices come back where the loop will not be busier than this with them; where it is, not quite all the time, one, then two,
#: four and so on, as long as that goes well and it will not be that busy
BUSY, FULLY = 0.9, 0.97
#: so long is looked at how busy it is; for twice as long each time that devices had to go again soon after some came back
CALM_S, MOST_CALM_S, SOON_S = 10.0, 640.0, 120.0


class Shedding:
    """Told of a queue of `room` messages about once a second by a steady clock, s.

    least: names of the devices that are heard, those first that may be left out first. floods: which of some send more than they
    may; they go before all others, and for as long as they do.
    """

    def __init__(
        self,
        room: int,
        least: Callable[[], Sequence[str]],
        floods: Callable[[Collection[str]], Collection[str]] = lambda _: (),
    ) -> None:
        self._room, self._least, self._floods = room, least, floods
        self._shed: dict[str, None] = {}  # in the order in which they went
        #: of them, how many messages came since it was looked; and who went on flooding until then
        self._flooding, self._still = dict[str, int](), set[str]()
        #: what came of devices, by name and key, since that was asked for
        self._came: dict[str, Counter[str]] = {}
        #: messages that were left out, in all
        self.messages = 0
        self._done = self._overflowed = self._lost = 0
        self._shortest: int | None = None  # the queue, since it was half full
        self._looked = self._since = self._readmitted = float("-inf")
        self._calm_s, self._busy_s, self._seen_s = CALM_S, 0.0, 0.0
        self._tried = 0  # how many came back last

    def __len__(self) -> int:
        return len(self._shed)

    def __iter__(self) -> Iterator[str]:
        return iter(self._shed)

    def __contains__(self, device: str) -> bool:
        return device in self._shed

    @property
    def lacking(self) -> bool:
        """Whether any is left out for want of room, and not for flooding."""
        return len(self._shed) > len(self._flooding)

    def sift(self, messages: Sequence[Message]) -> Sequence[Message]:
        """Those of devices that are not left out."""
        if self._shed:
            messages = [message for message in messages if not self._sheds(message.key)]
        self._done += len(messages)
        return messages

    def _sheds(self, key: str) -> bool:
        device = key.rpartition("/")[2]
        if device not in self._shed:
            return False
        self._came.setdefault(device, Counter())[key] += 1
        if device in self._flooding:
            self._flooding[device] += 1
        self.messages += 1
        return True

    def came(self, device: str) -> Counter[str]:
        """How many messages of it were left out since this was asked last, by their keys."""
        return self._came.pop(device, Counter())

    def drop(self, device: str) -> None:
        """It is ours no more."""
        self._shed.pop(device, None)
        self._flooding.pop(device, None)
        self._came.pop(device, None)

    def hold(self, now: float) -> None:
        """In place of a look: nothing can be heard, which is no rest."""
        self._watch(None, now)
        self._looked = now

    def look(self, now: float, *, waiting: int, overflowed: int, busy: float) -> None:
        """Once a second. waiting: messages in the queue; overflowed: that were dropped of it, in all; busy: the loop, 0 to 1."""
        passed_s, self._looked = now - self._looked, now
        self._still = {device for device, n in self._flooding.items() if n > A_SECOND * passed_s}
        self._flooding = dict.fromkeys(self._flooding, 0)
        lost, self._overflowed = overflowed - self._overflowed, overflowed
        self._lost += lost
        full = waiting > FILLED * self._room
        if lost and passed_s <= STALLED_S:
            self._too_much(waiting, now)
        elif passed_s > STALLED_S or full is (self._shortest is None):
            self._watch(waiting if full else None, now)
        elif not full:
            self._busy_s, self._seen_s = self._busy_s + busy * passed_s, self._seen_s + passed_s
            self._readmit(now)
        elif waiting < (self._shortest or 0):
            self._watch(waiting, now)
        elif now - self._since >= PATIENCE_S:
            self._too_much(waiting, now)

    def _too_much(self, waiting: int, now: float) -> None:
        more = max(0, waiting - (self._shortest or 0)) + self._lost
        self._leave_out(min(more / max(more + self._done, 1) + SPARE, MOST), now)
        self._watch(waiting if waiting > FILLED * self._room else None, now)

    def _watch(self, waiting: int | None, now: float) -> None:
        """From now on: a queue that is as long as that, or one that is short."""
        self._shortest, self._since, self._done, self._lost = waiting, now, 0, 0
        self._busy_s = self._seen_s = 0.0

    def _leave_out(self, share: float, now: float) -> None:
        heard = [device for device in self._least() if device not in self._shed]
        flooding = self._floods(heard)
        leaving = list(flooding) or heard[: math.ceil(share * (len(heard) - 1))]  # one stays, whatever it sends
        if not leaving:
            return
        self._tried = 0
        if not flooding:
            if now - self._readmitted < SOON_S:
                self._calm_s, self._readmitted = min(2 * self._calm_s, MOST_CALM_S), float("-inf")
            elif not self.lacking:
                self._calm_s = CALM_S
        self._shed |= dict.fromkeys(leaving)
        self._flooding |= dict.fromkeys(flooding, 0)
        self._still |= set(flooding)
        log.warning(
            "too much comes for this estimator: %s of %d left out, %s",
            count(len(leaving), "device"),
            len(heard),
            "by which it is flooded"
            if flooding
            else "first those without a calibration, then those that came last, until there is room again",
        )

    def _readmit(self, now: float) -> None:
        if not self._shed or now - self._since < self._calm_s:
            return
        busy = self._busy_s / max(self._seen_s, 1e-9)
        self._watch(None, now)
        able = [device for device in reversed(self._shed) if device not in self._still]
        heard = sum(device not in self._shed for device in self._least())
        room, most = (math.floor(heard * (limit / max(busy, 0.01) - 1.0)) for limit in (BUSY, FULLY))
        back = list(islice(able, max(room, min(2 * self._tried or 1, max(most, 1)) if busy < FULLY else 0)))
        self._tried = len(back)
        for device in back:
            del self._shed[device]
            self._flooding.pop(device, None)
        if back:
            self._readmitted = now
            log.info("there is room again for %s; %d are still left out", count(len(back), "device"), len(self._shed))
