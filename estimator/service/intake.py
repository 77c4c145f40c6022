"""What devices send: in through the door, each batch in its turn, of the boot it belongs to; what comes of it is told.

Batches that only go on take the fast lane; all else is handled here, one by one.
"""

import logging
import math
import time
from collections.abc import Callable, Sequence
from functools import partial

from bridge import rivals
from bridge.bus.contract import Message
from bridge.wire import codec, keys
from bridge.wire.messages import DeviceInfo, SampleBatch
from bridge.wire.refusal import Reason, Refusal
from estimator.door import Door
from estimator.outcome import Outcome
from estimator.overtaken import Overtaken
from estimator.service.boots import Boots
from estimator.service.device import Device
from estimator.service.isolation import Isolation
from estimator.service.lane import Lane
from estimator.service.roster import Roster
from estimator.service.sources import Ruling
from estimator.service.stock import Stock

log = logging.getLogger(__name__)

#: under this, samples are counted that waited for their turn when their device left: another corrects them
MOVED = "moved to another estimator"


class Intake:
    """Messages of the roster's devices in, outcomes out to `tell`.

    newcomer makes a device of the first batch of one, that came under a key at a time; None where there is no room.
    """

    def __init__(
        self,
        devices: Roster,
        boots: Boots,
        stock: Stock,
        guarded: Isolation,
        tell: Callable[[Device, Outcome], None],
        newcomer: Callable[[SampleBatch, str, float], Device | None],
    ) -> None:
        self._devices, self._boots, self._guarded = devices, boots, guarded
        self._tell, self._newcomer = tell, newcomer
        self._samples = Door[SampleBatch]("sample", stock.decode, self._refused)
        self._infos = Door[DeviceInfo]("info", codec.decode_info, self._refused)
        self._lane = Lane(self._on_samples, guarded, tell, stock.came)
        #: those with batches that wait for what is missing before them
        self._holding = dict[str, Device]()

    def take(self, messages: Sequence[Message]) -> None:
        """Messages of samples."""
        self._lane.take(messages)

    def settle(self) -> None:
        """Before all devices are looked at; see Lane."""
        self._lane.settle()

    def hear(self, message: Message) -> None:
        """What a bridge says of a device."""
        if (info := self._infos.take(message)) is None:
            return
        before = self._devices.info(info.bridge, info.device)
        self._devices.note(info)
        device = self._devices.get(info.device)
        if device is None or device.source.owner != info.bridge or device.session.boot != info.boot:
            return

        def introduced() -> None:
            if (outcome := self._boots.introduced(device, info, before)) is not None:
                self._tell(device, outcome)

        self._guarded(device, introduced)

    def give_up(self, now: float = math.inf, waits: Callable[[str], bool] = lambda _: False) -> None:
        """What was missing before batches that are held does not come; waits: whether messages of a key do, that may be it."""
        for device in list(self._holding.values()):
            if waits(device.key):
                continue
            self._handle(device, device.overtaken.overdue(now))
            if not device.overtaken:
                del self._holding[device.name]

    def leave(self, device: Device) -> None:
        """It is another estimator's, and what waits for its turn is, too."""
        self._lane.dismiss(device)
        self._holding.pop(device.name, None)
        for late in device.overtaken.drop():
            device.refuse(late, MOVED)
        device.drop_waiting()

    def refused(self) -> dict[str, int]:
        """Messages that the door did not let in, counted."""
        return {
            f"{door.name} messages refused, {reason}": n
            for door in (self._samples, self._infos)
            for reason, n in door.refused.as_dict().items()
        }

    def _refused(self, key: str, refusal: Refusal) -> None:
        try:
            device = self._devices.get(keys.parse(key).ids.get("device", ""))
        except Refusal:
            device = None
        if device is not None:
            device.session.count_event(f"refused {refusal.reason}")

    def _on_samples(self, message: Message) -> None:
        batch = self._samples.take(message)
        if batch is None:
            return
        now = time.monotonic()
        device = self._devices.get(batch.device) or self._newcomer(batch, message.key, now)
        if device is None:
            return
        if device.source.owns(batch.bridge, now):
            device.key = message.key
            self._lane.admit(message.key, device, batch.bridge)
            self._guarded(device, self._take, device, batch, now, came=len(batch))
            return
        if device.session.sequence.events.add(device.source.label(batch.bridge, now), len(batch)) == len(batch):
            # How many there are of them stands in its status.
            log.warning("%s (said once)", rivals.words([batch.device], device.source.owner, (batch.bridge,)))

    def _take(self, device: Device, batch: SampleBatch, now: float) -> None:
        session, overtaken = device.session, device.overtaken
        if device.known(batch):
            session.sequence.refuse(batch, Reason.DUPLICATE)
            return
        ruling = device.source.judge(batch, session.sequence, now)
        if ruling is Ruling.LATE:  # what is only said again is no sign of life: it may be a recording
            device.outdated = batch.boot, now
        else:
            device.heard = now
        if ruling is Ruling.RANGE:
            session.sequence.refuse(batch, Reason.RANGE)
            if session.count_event("refused leap") == 1:
                log.warning("%s: sample %d, a leap no device makes, is refused", device.name, batch.sequence)
            return
        if ruling is Ruling.LATE:
            self._tell(device, session.take(batch))
            return
        if ruling is Ruling.JUMP:
            self._handle(device, overtaken.drop())
            session.sequence.jump(batch)
        elif ruling is not Ruling.TAKE:
            for late in overtaken.drop():
                device.refuse(late, Reason.OLD_BOOT)
            if session.boot is not None:
                device.forget_said()
                device.overtaken = overtaken = Overtaken()  # where this one begins is not known
            device.drop_waiting()
            self._tell(device, self._boots.begin(device, batch, same=ruling is not Ruling.REPEAT))
        self._handle(device, overtaken.feed(batch, session.sequence.next, now))
        if overtaken:
            self._holding[device.name] = device

    def _handle(self, device: Device, batches: list[SampleBatch]) -> None:
        """Batches in their turn; one that fails is not the others' fault."""
        for batch in batches:
            self._guarded(device, partial(self._handle_one, device, batch), came=len(batch))

    def _handle_one(self, device: Device, batch: SampleBatch) -> None:
        if device.session.boot is None or device.session.begins_earlier(batch):
            self._boots.begin(device, batch)
        self._tell(device, device.session.take(batch))
