"""The fast lane: batches that only go on where their device was, checked, corrected and encoded many at once.

A batch is plain when it is whole and unmarked and follows the one before without a hole. Unless it ends a block of its
device correcting is all there is to do, and its session takes it in later, with the others of that block, or when somebody
looks at it (see Ahead). Everything else takes the door and the session's own way, which this one agrees with to the bit. What one
device says keeps its order.
"""

import time
from collections.abc import Callable, Sequence

from bridge.bus.contract import Message
from estimator.correction import Correction
from estimator.outcome import Outcome
from estimator.service.ahead import Ahead
from estimator.service.device import Device
from estimator.service.isolation import Isolation, counted
from estimator.service.roster import MAX_DEVICES
from estimator.service.senders import Sender, Senders
from estimator.service.sources import Mark
from estimator.service.together import Come, Round, Span

_MOST = 2 * MAX_DEVICES
_NOBODY: tuple[None, Sender] = None, Sender("", "", b"")

#: of a plain batch a part, or all of it: what corrects its samples from the first to the last
_Part = tuple[Device, Come, Correction, int, int]
Tell = Callable[[Device, Outcome], None]


class Lane:
    """Devices by the key of their raw samples; `take` does what is plain and hands the rest to `slow`, in order.

    guarded does some work of one device; tell publishes what a batch led to;
    count takes the number of samples in the batches that do not take the door.
    """

    def __init__(
        self, slow: Callable[[Message], None], guarded: Isolation, tell: Tell, count: Callable[[int], None]
    ) -> None:
        self._slow, self._guarded, self._tell, self._count = slow, guarded, tell, count
        self._senders, self._places = Senders(_MOST), dict[str, int]()
        #: by their places
        self._devices, self._aheads = dict[int, tuple[Device, Sender]](), dict[int, Ahead]()
        self._free = list[int]()

    def admit(self, key: str, device: Device, bridge: str) -> None:
        """What comes under this key is of this device, from this bridge."""
        known = self._places.get(key)
        if known is not None:
            if self._devices[known][0] is device:  # a key names its bridge, too
                return
            self._leave(key)
        if len(self._places) >= _MOST:
            for each in list(self._places):  # of devices that are no more, too; those that are will be admitted again
                self._leave(each)
        place, sender = self._free.pop() if self._free else len(self._devices), Sender.of(device.name, bridge)
        self._places[key], self._devices[place], self._aheads[place] = place, (device, sender), device.ahead
        self._senders.admit(place, sender)
        device.take_in = self._take_in

    def dismiss(self, device: Device) -> None:
        """It is ours no more."""
        for key in [key for key, place in self._places.items() if self._devices[place][0] is device]:
            self._leave(key)

    def _leave(self, key: str) -> None:
        place = self._places.pop(key)
        self._devices[place][0].leave_place(place)
        del self._devices[place], self._aheads[place]
        self._senders.lose(place)
        self._free.append(place)

    def take(self, messages: Sequence[Message]) -> None:
        """A round of messages."""
        if not messages:
            return
        now, known = time.monotonic(), self._places
        places = [known.get(key, -1) for key, _ in messages]
        whole = Round([payload for _, payload in messages], places, self._senders, goes_on=True)
        others = sorted([*self._go_ahead(messages, places, whole, now), *whole.others])
        admitted = [self._devices.get(places[number], _NOBODY) for number in others]
        self._take_in(*{device for device, _ in admitted if device is not None and device.ahead.held})
        going, came = dict[str, list[_Part]](), 0
        for number, (device, sender) in zip(others, admitted, strict=True):
            message, plain = messages[number], False
            if device is not None and whole.fit(number):
                before = counted(device)
                try:
                    if plain := _plain(device, sender.bridge, whole.span(number)):
                        come = whole.come(number, number + 1, sender)
                        self._go_on(device, come, now, whole, going.setdefault(message.key, []))
                except Exception as error:  # noqa: BLE001 - whatever it is, it stays with its device
                    self._guarded.failed(
                        device, error, before, came=whole.samples([number]), follows=whole.following(number)
                    )
                    plain = True
            if plain:
                came += whole.samples([number])
            else:
                self._send(whole, going.pop(message.key, []))
                self._slow(message)
        self._count(came)
        self._send(whole, [part for held in going.values() for part in held])
        for key, parts in going.items():
            if parts:
                device, come, *_ = parts[-1]
                self._guarded(device, self._stand, key, device)

    def settle(self) -> None:
        """Before all devices are looked at: each session takes in all that came, together at a third of the price."""
        self._take_in(*{device for device, _ in self._devices.values() if device.ahead.held})

    # ---- ahead of sessions ----------------------------------------------------------------------------------------

    def _go_ahead(self, messages: Sequence[Message], places: list[int], whole: Round, now: float) -> list[int]:
        """Publish what only goes on and let it be held; messages that have to take another way all the same."""
        which, aheads, back = whole.ahead, self._aheads, list[int]()
        for number, said in zip(which.tolist(), whole.corrected_ahead(which), strict=True):
            ahead = aheads[places[number]]
            try:
                if not said or not (ahead.sure or self._sure(places[number], whole, number)):
                    ahead.sure = False
                    back.append(number)
                    continue
                ahead.put(said)
            except Exception as error:  # noqa: BLE001 - as above
                device, _ = self._devices[places[number]]
                came, follows = whole.samples([number]), whole.following(number)
                self._guarded.failed(device, error, counted(device), came=came, follows=follows)
                continue
            ahead.held.append(messages[number].payload)
            ahead.heard = now
        self._count(whole.samples(which) - whole.samples(back))
        return back

    def _sure(self, place: int, whole: Round, number: int) -> bool:
        """Whether a message goes on where its device's session is, which somebody had since, too."""
        (device, sender), span = self._devices[place], whole.span(number)
        session = device.session
        if (
            session.applied is not device.ahead.correction
            or session.ends_block(span.last_s)
            or not _plain(device, sender.bridge, span)
        ):
            return False
        device.delayed(span.received_ns)
        device.ahead.sure = True
        return True

    def _stand(self, key: str, device: Device) -> None:
        """A batch was plain: what comes next may go on ahead of the session."""
        session, ahead, place = device.session, device.ahead, self._places.get(key, -1)
        boot, following = session.boot, session.sequence.next
        if self._devices.get(place, _NOBODY)[0] is not device or boot is None or following is None:
            return
        if device.repeats(following):  # what goes ahead is published without asking whether it was
            return
        if ahead.place != place:
            if ahead.place >= 0:
                self._senders.lose(ahead.place)
            ahead.place, ahead.correction = place, None
        correction = session.applied
        if ahead.correction is not correction:
            stencil = device.stencil(boot, correction)
            if not self._senders.corrects(place, correction, stencil):
                ahead.correction = None
                return
            ahead.correction = correction
        self._senders.stands(place, boot, following, session.point)

    def _take_in(self, *devices: Device) -> None:
        """Sessions take in what was corrected ahead of them."""
        if not devices:
            return
        held = [device.ahead.release() for device in devices]
        places = [device.ahead.place for device, payloads in zip(devices, held, strict=True) for _ in payloads]
        whole = Round([payload for payloads in held for payload in payloads], places, self._senders, goes_on=False)
        begin = 0
        for device, payloads in zip(devices, held, strict=True):
            before, end, n = counted(device), begin + len(payloads), 0
            try:
                n = whole.samples(slice(begin, end))
                device.published(n)  # they were, whatever comes of it here
                come = whole.come(begin, end, self._devices[device.ahead.place][1])
                _took(device, come, device.heard)
                device.session.keep(come.sent, come.rows, come.received_ns)
            except Exception as error:  # noqa: BLE001 - as above
                self._guarded.failed(device, error, before, came=n, follows=whole.following(end - 1))
            begin = end

    # ---- what is more than that -----------------------------------------------------------------------------------

    def _go_on(self, device: Device, come: Come, now: float, whole: Round, going_on: list[_Part]) -> None:
        session, rows = device.session, come.rows
        device.heard = now
        _took(device, come, now)
        if not session.ends_block(come.last_s):
            session.keep(come.sent, rows, come.received_ns)
            going_on.append((device, come, session.applied, 0, len(rows)))
            return
        outcome, cuts = session.end_block(come.sent, rows, come.received_ns)
        if outcome.worded:  # after the samples that led to it, and before the first that it is applied to
            self._send(whole, going_on)
            going_on.clear()
        if self._guarded(device, self._tell, device, outcome, owed=len(rows)):
            going_on += [(device, come, *cut) for cut in cuts]

    def _send(self, whole: Round, parts: list[_Part]) -> None:
        """Correct samples of a round and publish them, in order."""
        if not parts:
            return
        said = whole.corrected([part[1:] for part in parts])
        for (device, come, correction, first, last), samples in zip(parts, said, strict=True):
            before = counted(device)
            try:
                if samples:
                    device.say_rates(come.sent.boot, come.sent.sequence + first, correction, samples, last - first)
                else:  # a rate is beyond what the wire takes
                    device.say_corrected([correction.apply(come.sent.where(0)[0], first, last)])
            except Exception as error:  # noqa: BLE001 - as above
                self._guarded.failed(device, error, before, owed=last - first)


def _took(device: Device, come: Come, heard_s: float) -> None:
    device.source.went_on(Mark(come.following, come.last_s, come.received_ns, heard_s), come.earliest_ns)


def _plain(device: Device, bridge: str, at: Span) -> bool:
    """Whether a batch is plain."""
    return (
        bridge == device.source.owner
        and device.announced
        and not device.overtaken
        and device.session.plain(at.boot, at.sequence, at.first_s, at.last_s, at.samples)
    )
