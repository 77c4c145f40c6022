"""What comes to a service against what it can do: how busy it is; of more than that who is not learnt from, or left out."""

import time
from collections.abc import Callable, Collection, Sequence

from bridge.bus.contract import Message, Subscription
from bridge.wire.refusal import Tally
from estimator.lifecycle import Event
from estimator.service.coasting import Coasting
from estimator.service.device import Device
from estimator.service.overload import OVERLOADED, Overload
from estimator.service.roster import Roster
from estimator.service.shedding import SHED, WHY, Shedding


class Load:
    """Of a queue of at most `room` messages; looked at about once a second.

    floods: whether more comes under a key than may. What is noticed is counted in `counts`, and stands in the devices.
    """

    def __init__(
        self,
        queue: Subscription,
        room: int,
        devices: Roster,
        floods: Callable[[str], bool],
        counts: Tally,
        silence_s: float,
    ) -> None:
        self._queue, self._devices, self._floods, self._counts = queue, devices, floods, counts
        self._silence_s = silence_s
        self._overload = Overload(time.monotonic())
        self._coasting = Coasting(self._able)
        self._shedding, self._shed = Shedding(room, self._least, self._flooding), 0

    @property
    def busy(self) -> float:
        """The share of the last second in which the loop had something to do."""
        return self._overload.ratio

    def idle(self, seconds: float) -> None:
        """The loop had nothing to do for so long."""
        self._overload.idle(seconds)

    def sift(self, messages: Sequence[Message]) -> Sequence[Message]:
        """Those of devices that are not left out."""
        return self._shedding.sift(messages)

    def drop(self, device: str) -> None:
        """It is ours no more."""
        self._shedding.drop(device)

    def look(self, now: float, *, connected: bool, unkept: bool) -> None:
        """Once a second. unkept: what is learnt of devices is not written down."""
        overflowed, waiting = self._queue.overflowed, self._queue.waiting
        waited_s, less = self._queue.waited_s, bool(self._shedding or self._coasting)
        over_s = self._overload.look(now, overflowed=overflowed, waited_s=waited_s, shedding=less)
        for name in [name for name in self._shedding if name not in self._devices]:
            self._shedding.drop(name)
        if connected:
            busy = self._overload.ratio
            lacking = self._shedding.lacking
            self._coasting.look(now, waiting=waiting, waited_s=waited_s, busy=busy, shedding=lacking)
            self._shedding.look(now, waiting=waiting, overflowed=overflowed, busy=busy)
        else:
            self._shedding.hold(now)
        if shed := self._shedding.messages - self._shed:
            self._counts.add(SHED, shed)
            self._shed += shed
        if over_s:
            self._counts.add(f"{OVERLOADED}, seconds", max(1, round(over_s)))
        for device in self._devices.values():
            device.overloaded_s, device.unkept = self._overload.seconds, unkept
            device.left_out = device.name in self._shedding
            device.session.coasts = device.name in self._coasting

    def tell(self, device: Device, now: float) -> None:
        """A device what of it was left out: it is heard, and not looked at."""
        if shed := self._shedding.came(device.name):
            device.session.sequence.events.add(SHED, shed.total())
            if device.key in shed:
                device.heard = now
                device.source.hold(now)
            if device.left_out:
                device.session.silence(WHY, Event.SHED)

    def _able(self) -> list[str]:
        """Devices that are heard, and whose bias may be only predicted for a while."""
        return [device.name for device in self._heard() if not device.left_out and device.session.may_coast]

    def _heard(self) -> list[Device]:
        since = time.monotonic() - self._queue.waited_s - self._silence_s
        return [device for device in self._devices.values() if device.heard >= since]

    def _least(self) -> list[str]:
        """Devices that are heard, those first that can be done without: not calibrated, and not being so; that came last."""

        def wanting(device: Device) -> tuple[bool, bool]:
            learnt = device.session.learnt
            return not (learnt.turned or learnt.asked), learnt.calibration is None and learnt.prior is None

        return [device.name for device in sorted(self._heard(), key=wanting)[::-1]]

    def _flooding(self, devices: Collection[str]) -> list[str]:
        return [name for name in devices if (d := self._devices.get(name)) is not None and self._floods(d.key)]
