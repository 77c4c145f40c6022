"""Load shedding, by whole devices: of more than can be done some whole are worth more than all in pieces. Pure.

While its queue is more than half full and becomes no shorter, devices are left out until what is left can be done. They come
back as soon as there is room for them.
"""

import logging
import math
from collections.abc import Callable, Sequence

from bridge.bus.contract import Message
from bridge.wording import count

log = logging.getLogger(__name__)

#: messages of devices that are left out are counted under this
SHED = "messages shed"
#: why a device is where it is, meanwhile
WHY = (
    "the estimator has more devices than it can handle: what this one sends is not looked at until there is room again"
)
#: a queue that is fuller than this share, and was never shorter for so long, ...
FILLED, PATIENCE_S = 0.5, 4.0
#: ... is one to which too much comes, and by this share more: what waits is to be done, too. So much at once at most: it may be
#: something else that takes our time
SPARE, MOST = 0.1, 0.25
#: devices come back where the loop will not be busier than this with them, by what was so for so long; each time that was too
#: soon it is looked at for twice as long
BUSY, CALM_S, MOST_CALM_S, SOON_S = 0.9, 10.0, 640.0, 120.0


class Shedding:
    """Told of a queue of `room` messages once a second by a steady clock, s.

    least: names of all devices, those first that may be left out first.
    """

    def __init__(self, room: int, least: Callable[[], Sequence[str]]) -> None:
        self._room, self._least = room, least
        #: who is left out, latest last, and how many messages of it came since it was asked for
        self._shed: dict[str, int] = {}
        self._done = self._overflowed = self._lost = 0
        self._shortest: int | None = None  # the queue, since it was half full
        self._since = self._readmitted = float("-inf")
        self._calm_s, self._busiest = CALM_S, 0.0

    def __len__(self) -> int:
        return len(self._shed)

    def __contains__(self, device: str) -> bool:
        return device in self._shed

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
        self._shed[device] += 1
        return True

    def came(self, device: str) -> int:
        """How many messages of it were left out since this was asked last."""
        came = self._shed.get(device, 0)
        if came:
            self._shed[device] = 0
        return came

    def drop(self, device: str) -> None:
        """It is ours no more."""
        self._shed.pop(device, None)

    def look(self, now: float, *, waiting: int, overflowed: int, busy: float) -> None:
        """Once a second. waiting: messages in the queue; overflowed: that were dropped of it, in all; busy: the loop, 0 to 1."""
        self._lost += overflowed - self._overflowed
        self._overflowed = overflowed
        if waiting <= FILLED * self._room:
            if self._shortest is not None:
                self._watch(None, now)
            self._readmit(now, busy)
        elif self._shortest is None or waiting < self._shortest:
            self._watch(waiting, now)
        elif now - self._since >= PATIENCE_S:
            more = waiting - self._shortest + self._lost
            self._leave_out(min(more / max(more + self._done, 1) + SPARE, MOST), now)
            self._watch(waiting, now)

    def _watch(self, waiting: int | None, now: float) -> None:
        """From now on: a queue that is as long as that, or one that is short."""
        self._shortest, self._since, self._done, self._lost, self._busiest = waiting, now, 0, 0, 0.0

    def _leave_out(self, share: float, now: float) -> None:
        heard = [device for device in self._least() if device not in self._shed]
        leaving = heard[: math.ceil(share * (len(heard) - 1))]  # one stays, whatever it sends
        if not leaving:
            return
        too_soon = now - self._readmitted < SOON_S
        self._calm_s = min(2 * self._calm_s, MOST_CALM_S) if too_soon else CALM_S
        self._shed |= dict.fromkeys(leaving, 0)
        log.warning(
            "too much comes for this estimator: %s of %d left out, %s in all, first those without a calibration, then those that"
            " came last; what they send is not looked at until there is room again",
            count(len(leaving), "device"),
            len(heard) + len(self._shed) - len(leaving),
            len(self._shed),
        )

    def _readmit(self, now: float, busy: float) -> None:
        self._busiest = max(self._busiest, busy)
        if not self._shed or now - self._since < self._calm_s:
            return
        heard = sum(device not in self._shed for device in self._least())
        room = math.floor(heard * (BUSY / max(self._busiest, 0.01) - 1.0))
        self._watch(None, now)
        back = list(self._shed)[-room:] if room > 0 else []
        for device in back:
            del self._shed[device]
        if back:
            self._readmitted = now
            log.info("there is room again for %s; %d are still left out", count(len(back), "device"), len(self._shed))
