"""The estimator as a service: the only thread that touches sessions and store, between the bus and the pure cores."""

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Sequence
from functools import partial

from bridge.bus.contract import Bus, Message, Publisher
from bridge.enrolled import Enrolment
from bridge.router_watch import RouterWatch
from bridge.wire import keys
from bridge.wire.messages import Checkpoint
from bridge.wire.refusal import Tally
from estimator.config import Estimator
from estimator.device.reorder_buffer import ReorderBuffer
from estimator.device.samples import Samples
from estimator.device_knobs import treatment
from estimator.lifecycle import Event
from estimator.outcome import Outcome
from estimator.restore import changed
from estimator.service.boots import Boots
from estimator.service.clerk import Clerk
from estimator.service.commands import Commands
from estimator.service.device import Device
from estimator.service.gate import Gate, Notices
from estimator.service.intake import Intake
from estimator.service.interim import Interim
from estimator.service.isolation import Isolation
from estimator.service.load import Load
from estimator.service.lost import Lost
from estimator.service.orders import Orders
from estimator.service.peers import Peers
from estimator.service.presence import Presence
from estimator.service.quiet import Kind, Quiet
from estimator.service.record import Record
from estimator.service.replicas import remembered_of
from estimator.service.resumed import Resumed
from estimator.service.roster import Roster
from estimator.service.silent import Silent
from estimator.service.stock import Stock
from estimator.service.store import Store
from estimator.service.totals import Totals
from estimator.service.turns import FLOODED, Turns
from estimator.service.views import Views
from estimator.service.vitals import Vitals

log = logging.getLogger(__name__)

STATUS_S = 1.0
#: so many messages at most in a round: then there are more to be read
MANY = 512
#: so many wait for a round at most
QUEUE = 65536
#: a round that takes longer is held against nobody
SLOW_S = 0.5
#: how long the last samples are corrected after a stop was asked for
DRAIN_S = 2.0
#: how long what was said of the rates of a device that has left us may still be asked for
LINGER_S = 40.0
#: messages of a device that are asked for of what a bridge keeps where others are there already: what may wait with them to be
#: corrected, 12 s of the usual 50 ms. All of it, of some hundred devices, would keep us behind them for as long
PAST_IN_COMPANY = 240


class Service:
    """A running estimator. Samples and results go over `data`; commands and liveliness over `control`, its own session.

    peers: ids of other estimators of the ward that were seen already. tend is told once a second how many devices there are.
    """

    def __init__(
        self,
        ward: str,
        settings: Estimator,
        data: Bus,
        control: Bus,
        store: Store,
        now_ns: Callable[[], int] = time.time_ns,
        vitals: Vitals | None = None,
        clerk: Clerk | None = None,
        enrolment: Enrolment | None = None,
        peers: Collection[str] = (),
        tend: Callable[[int], None] = lambda _: None,
    ) -> None:
        self.ward, self.settings = ward, settings
        self.counts, self._tend = Tally(), tend
        self._bus, self._control, self._now_ns, self._store_path = data, control, now_ns, store.path
        self._peers = Peers(ward, settings.id, data, control, now_ns, self.counts, peers)
        cluster = self._peers.cluster
        self._guarded = Isolation(self.counts)
        self._record = Record(
            store,
            self.counts,
            now_ns,
            clerk,
            self._peers.replicas,
            self._peers.tell,
            lambda: cluster.highest,
            self._guarded,
        )
        cluster.hear(self._record.epoch())
        self._left = deque[tuple[float, Publisher]]()
        #: to be adopted once its device is heard again
        self._missed = dict[str, Checkpoint]()
        self._treatment = treatment(settings)
        self._silent = Silent(data, ward, self._peers.replicas, self._treatment.of)
        self._devices = Roster(self.counts, settings.silence_s)
        self._interim = Interim(
            data, ward, self._peers.replicas, self._treatment.of, now_ns, self.counts, self._devices.info
        )
        self._stock = Stock(self._devices, self.counts, vitals or Vitals())
        self._intake = Intake(
            self._devices,
            Boots(self._devices, self._record, self._guarded),
            self._stock,
            self._guarded,
            self._tell,
            self._newcomer,
        )
        self._presence, self._views = Presence(self.counts), Views(self.counts)
        self._gate = Gate(enrolment, self.counts)
        self._notices = Notices(data, ward, self._gate)
        self._turns = Turns(self._intake.take, self._flooded)
        self._resumed = Resumed(self._record.reached(), self._stock.came, self.counts, self._catch_up, time.monotonic())
        #: whether what was said before a restart still comes
        self._returns = not self._resumed.over
        self._lost = Lost(self._presence, self._gate, self._turns, settings.silence_s)
        self._quiet = Quiet(lambda: self._raw.waited_s > 0 or self._pressing)
        self._orders = Orders(self._devices, self._record, self._gate, self._silent, self._guarded, self.counts, now_ns)
        self._commands = Commands(self._peers.answers, lambda reason: self.counts.add(f"commands {reason}"))
        self._next_status, self._looked = 0.0, time.monotonic()
        self._router = RouterWatch(log, STATUS_S, vitals.routers if vitals else None)
        # Of a past that there is no room for the oldest is what others, or we before a restart, have corrected.
        self._raw = data.subscribe(
            keys.pattern(ward, "raw"),
            history=True,
            capacity=QUEUE,
            all_past=False,
            most_past=PAST_IN_COMPANY if peers else None,
        )
        self._load = Load(self._raw, QUEUE, self._devices, self._turns.floods, self.counts, settings.silence_s)
        self._peers.on_token = self._raw.wake
        self._info = data.subscribe(keys.pattern(ward, "info"), history=True)
        self._totals = Totals()
        self._declared = [
            control.answer(keys.pattern(ward, "rpc"), self._commands.ask),
            control.declare_alive(keys.build(ward, "alive/estimator", estimator=settings.id)),
            control.watch_alive(keys.pattern(ward, "alive/device"), self._presence.change),
            control.watch_alive(keys.pattern(ward, "alive/bridge"), self._presence.change),
        ]

    def run(self, stop: threading.Event) -> None:
        """Serve until stopped, then say goodbye: the last samples are corrected, the bias kept, the tokens taken back."""
        log.info("estimator %s serves ward %s, store %s", self.settings.id, self.ward, self._store_path)
        while not stop.is_set():
            self.step(0.05)
        deadline = time.monotonic() + DRAIN_S
        while (self.step(0.0) or self._peers.pressing) and time.monotonic() < deadline:
            pass
        self._intake.give_up()
        self._quiet.finish()
        now = time.monotonic()
        for device in self._devices.values():
            self._guarded(device, partial(self._record.checkpoint, device, now, force=True))
        self._record.close()
        self._totals.tell(now, self._count_all(), last=True)
        self._peers.say(self._devices, math.inf)
        for _, publisher in self._left:
            publisher.close()
        for thing in (
            *self._declared,
            self._peers,
            self._raw,
            self._info,
            self._notices,
            self._silent,
            self._interim,
            *self._devices.values(),
        ):
            thing.close()
        log.info("estimator %s stopped", self.settings.id)

    def step(self, timeout_s: float) -> int:
        """One round: what has come in, what was asked, what is due. How many sample messages came or still wait."""
        waits = time.monotonic()
        hurry = self._pressing or self._quiet
        # After a restart: first all that was done before it is left aside, then what is soon done of the rest is begun with.
        most = QUEUE if self._returns and not self._peers.company else MANY
        messages = self._raw.drain(0 if self._turns.full else most, 0.0 if hurry else timeout_s)
        began = time.monotonic()
        self._load.idle(began - waits)
        self._returns &= len(messages) >= MANY or not self._raw.caught_up
        if len(messages) >= MANY or not self._raw.caught_up:
            self._peers.cluster.behind(began)
        messages = self._resumed.left(self._gate.admit(messages, began), began)
        for message in self._gate.admit(self._info.drain(512, 0.0), began):
            self._intake.hear(message)
        self._turns.round(self._ours(messages, began))
        self._commands.work(self._orders.do)
        now = time.monotonic()
        self._record.collect(now)
        self._intake.give_up(now, self._turns.waits)
        self._views.say(now)
        if now - began > SLOW_S:
            for device in self._devices.values():
                # What came meanwhile still waits: our own slowness is nobody's silence. Nobody is heard later than now.
                device.heard = min(device.heard + now - began, now)
        if now >= self._next_status:
            self._next_status = now + STATUS_S
            self._every_second(now)
        if self._peers.due(now):
            self._peers.say(self._devices, now)
        self._quiet.work()
        return len(messages) + self._turns.waiting

    @property
    def _pressing(self) -> bool:
        """Whether there are samples to be seen to even if none come."""
        return self._turns.pressing or self._peers.pressing

    # ---- several estimators ---------------------------------------------------------------------------------------

    def _ours(self, messages: Sequence[Message], now: float) -> Sequence[Message]:
        """Give up and take over devices as it is their turn; of what came, that of our devices."""
        if lost := self._peers.look(now, heard=bool(messages)):
            self._give_away(lost, now)
        for known in self._peers.calibrated():
            self._adopt(known)
        ours = self._load.sift(self._peers.sift(messages, now))
        self._interim.go_on(self._peers.meanwhile())
        taken = self._peers.taken_over(self._devices, self._silent, now)
        queues = self._peers.turn()
        if not (taken or queues or self._interim.behind):
            return ours
        self._turns.round(ours)  # to take over takes long
        self._interim.catch_up()
        if taken and self._devices.roomy(self._peers.waiting):
            self._interim.say(taken)
        # The first of each device comes first: until then it is not known that there is one.
        self._turns.round([queue[0] for queue in queues if queue])
        return [message for queue in queues for message in queue[1:]]

    def _give_away(self, names: list[str], now: float) -> None:
        """Devices that another estimator has: it goes on from where we were."""
        for name in names:
            self._silent.drop(name)
            self._load.drop(name)
            self._missed.pop(name, None)
            self._left += [(now + LINGER_S, publisher) for publisher in self._interim.drop(name)]
        leaving = [device for name in names if (device := self._devices.get(name)) is not None]
        for device in leaving:
            for message in self._turns.withdraw(device.name):
                self._peers.back(device.name, message, now)
            self._intake.leave(device)
            self._learn(device)
            self._guarded(device, partial(self._record.checkpoint, device, now, force=True))
        self._stock.check()  # while they are counted
        for device in leaving:
            self._stock.leave(device.name)
            del self._devices[device.name]
            self._left += [(now + LINGER_S, publisher) for publisher in device.leave()]

    def _adopt(self, known: Checkpoint) -> None:
        """Another has calibrated it while neither heard of the other: its turns are not to be taken again."""
        device, remembered = self._devices.get(known.device), remembered_of(known, self._now_ns())
        if device is None or remembered is None or (calibration := remembered.calibration) is None:
            return
        session = device.session
        if session.boot != calibration.boot or session.calibration is not None:
            return
        if session.life.away:
            self._missed[device.name] = known
            return
        if self._record.of_before(device, calibration):
            return
        if session.info is not None and changed(calibration, session.info, within_boot=True):
            return  # it has been void since

        def adopted() -> None:
            device.repeated = None
            session.adopt(remembered, calibration)
            log.info("%s: %s", device.name, session.life.reason)
            self._record.keep(device, calibration)
            device.say_status(self._now_ns())

        self._guarded(device, adopted)

    # ---- what comes in --------------------------------------------------------------------------------------------

    def _newcomer(self, batch: Samples, key: str, now: float) -> Device | None:
        """A device not known before: with the bridge another estimator heard it from, and from the first sample there is."""
        if not self._devices.room(now, batch.n):
            self._left += [(now + LINGER_S, publisher) for publisher in self._interim.drop(batch.device)]
            return None
        name, knobs, epoch = batch.device, self._treatment.of(batch.device), self._peers.epoch(batch.device)
        device = Device(self._bus, self.ward, name, knobs, self.settings.silence_s, now, epoch, batch.first_s)
        lately = "" if name in self._silent else self._peers.replicas.lately_from(name, self._now_ns())
        if known := lately or self._resumed.bridge(name, batch.receive_time_ns):
            device.source.owns(known, now)
        if self._peers.company or self._resumed.goes_on(key):
            device.reorder_buffer = ReorderBuffer(batch.sequence)
        self._silent.drop(name)
        self._interim.hand_over(device)
        self._devices[name] = device
        return device

    def _flooded(self, key: str, messages: int) -> None:
        self.counts.add(FLOODED, messages)
        device = self._devices.get(key.rpartition("/")[2])
        if device is not None and device.session.sequence.events.add(FLOODED, messages) == messages:
            log.warning("%s: sends more than can be handled; the oldest is dropped (more is only counted)", device.name)

    def _catch_up(self, key: str, goes_on: bool) -> None:  # noqa: FBT001 - Resumed's contract
        """Where there are others our devices were theirs meanwhile: they come back as it is their turn."""
        if not self._peers.company:
            self._turns.behind(key, soon=goes_on)

    def _learn(self, device: Device) -> None:
        if device.session.to_learn:
            self._guarded(device, self._learnt, device)

    def _learnt(self, device: Device) -> None:
        self._tell(device, device.session.learn())

    # ---- what goes out --------------------------------------------------------------------------------------------

    def _tell(self, device: Device, outcome: Outcome) -> None:
        for words in outcome.said:
            log.info("%s: %s", device.name, words)
        for made in outcome.calibrations:
            if device.session.calibration is made:
                device.repeated = None
            self._record.calibration(device, made, time.monotonic())
        if outcome.seconds:
            self._views.take(device, outcome.seconds)
        for revision in outcome.revisions:
            device.say_revision(revision)
        if outcome.changed:
            self._say_changed(device)
            if device.session.learnt.turned:
                self._peers.tell(device)  # or nobody could say that they are lost with us
            self._turns.slow(device.key, now=device.session.learnt.near)
        if device.session.to_learn:
            kind = Kind.CALIBRATE if device.session.learnt.near else Kind.LEARN
            self._quiet.add(kind, device.name, partial(self._learn, device))

    def _say_changed(self, device: Device) -> None:
        """Its status; of one that is taken over rates come first: it may be one of a hundred."""
        if device.latest is None and self._peers.replicas.bridge(device.name):
            self._quiet.add(Kind.LOOK, device.name, partial(self._look_after, device))
        else:
            device.say_status(self._now_ns())

    def _every_second(self, now: float) -> None:
        self._tend(len(self._devices))
        self._stock.check()
        self._gate.look(now)
        self._notices.say(self._now_ns(), self._devices)
        self._load.look(now, connected=self._bus.connected, unkept=bool(self._record.trouble))
        while self._left and self._left[0][0] <= now:
            self._left.popleft()[1].close()
        self._presence.note(now)
        connected = self._bus.connected
        if not self._control.connected:
            self._presence.forget()
        if self._router.look(now, connected=connected):
            for device in self._devices.values():  # nothing can be heard: unknown, not lost
                # Who was silent before is no more so by that, and no less.
                was_silent = now - device.heard > self.settings.silence_s + STATUS_S
                device.heard = min(now, device.heard + now - self._looked) if was_silent else now
                device.source.hold(now)
                if not connected:
                    device.session.silence("the router is gone: whether it still sends is not known", Event.UNREACHABLE)
        self._looked = now
        for device in self._devices.values():
            self._quiet.add(Kind.LOOK, device.name, partial(self._look_after, device))
        ready = self._interim.ready
        for name, work in ready.ahead(self._peers.next_in_line(ready.publishers)):
            self._quiet.add(Kind.LOOK, f"{name}, ready", work)  # beside its own, once it is ours
        self._silent.say(self._now_ns())
        self._record.tend(now)
        counts = self._count_all()
        self._totals.tell(now, counts)
        self._stock.note(now, self._record.trouble, counts, connected=connected, busy=self._load.busy)

    def _look_after(self, device: Device) -> None:
        if self._devices.get(device.name) is device:
            self._guarded(device, self._looked_after, device, time.monotonic())

    def _looked_after(self, device: Device, now: float) -> None:
        if (missed := self._missed.pop(device.name, None)) is not None:
            self._adopt(missed)
        self._load.tell(device, now)
        self._lost.look(device, now, self._raw.waited_s)
        device.say_status(self._now_ns())
        self._stock.see(device)
        device.look_round()
        self._record.checkpoint(device, now)

    def _count_all(self) -> dict[str, int]:
        missed = {"sample messages missed": self._raw.missed, "info messages missed": self._info.missed}
        met = self._intake.refused() | self._peers.refused() | self.counts.as_dict()
        return met | {label: n for label, n in missed.items() if n}
