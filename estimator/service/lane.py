"""The fast lane: batches that only go on where their device was, checked, corrected and encoded many at once.

A batch is plain when it is whole and unmarked and follows the one before without a hole. Unless it ends a half second of its
device correcting is all there is to do. Everything else takes the door and the session's own way, which this one agrees with
to the bit. What one device says keeps its order.
"""

import time
from collections.abc import Callable, Sequence

from bridge.bus.contract import Message
from estimator.correction import Correction
from estimator.outcome import Outcome
from estimator.service.device import Device
from estimator.service.isolation import Isolation, counted
from estimator.service.roster import MAX_DEVICES
from estimator.service.together import Come, Round, Sender, read

_MOST = 2 * MAX_DEVICES
_NOBODY = None, None

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
        self._devices: dict[str, tuple[Device, Sender]] = {}

    def admit(self, key: str, device: Device, bridge: str) -> None:
        """What comes under this key is of this device, from this bridge."""
        known = self._devices.get(key)
        if known is not None and known[0] is device:  # a key names its bridge, too
            return
        if len(self._devices) >= _MOST:
            self._devices.clear()  # of devices that are no more, too; those that are will be admitted again
        self._devices[key] = device, Sender.of(device.name, bridge)

    def dismiss(self, device: Device) -> None:
        """It is ours no more."""
        for key in [key for key, (admitted, _) in self._devices.items() if admitted is device]:
            del self._devices[key]

    def take(self, messages: Sequence[Message]) -> None:
        """A round of messages."""
        if not messages:
            return
        now, came, known = time.monotonic(), 0, self._devices
        admitted = [known.get(key, _NOBODY) for key, _ in messages]
        whole = read([payload for _, payload in messages], [sender for _, sender in admitted])
        going = dict[str, list[_Part]]()
        for message, (device, _), come in zip(messages, admitted, whole.come, strict=True):
            if come is None or device is None or not _plain(device, come):
                self._send(whole, going.pop(message.key, []))
                self._slow(message)
                continue
            n, going_on, before = len(come.rows), going.setdefault(message.key, []), counted(device)
            came += n
            try:
                self._go_on(device, come, now, whole, going_on)
            except Exception as error:  # noqa: BLE001 - whatever it is, it stays with its device
                self._guarded.failed(device, error, before, came=n)
        self._count(came)
        self._send(whole, [part for held in going.values() for part in held])

    def _go_on(self, device: Device, come: Come, now: float, whole: Round, going_on: list[_Part]) -> None:
        session, (batch, rows, _, last_s, _) = device.session, come
        device.heard = now
        device.source.went_on(batch, now)
        if not session.ends_block(last_s):
            session.keep(batch, rows)
            going_on.append((device, come, session.applied, 0, len(rows)))
            return
        outcome, cuts = session.end_block(batch, rows)
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
                    device.say_rates(come.batch, correction, samples, last - first)
                else:  # a rate is beyond what the wire takes
                    device.say_corrected([correction.apply(come.batch, first, last)])
            except Exception as error:  # noqa: BLE001 - as above
                self._guarded.failed(device, error, before, owed=last - first)


def _plain(device: Device, come: Come) -> bool:
    """Whether a batch is plain."""
    batch = come.batch
    return (
        batch.bridge == device.source.owner
        and device.announced
        and not device.overtaken
        and device.session.plain(batch.boot, batch.sequence, come.first_s, come.last_s)
    )
