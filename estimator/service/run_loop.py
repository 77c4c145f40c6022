"""Run loop of the estimator: the only thread that touches sessions and store, between the bus and the pure cores."""

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Sequence
from functools import partial

from bridge.bus.contract import Bus, Message, Publisher
from bridge.bus.router_watch import RouterWatch
from bridge.config.enrolment import Enrolment
from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.wire import keys
from bridge.wire.messages import Checkpoint
from bridge.wire.refusal import Tally
from estimator.config.device_settings import treatment
from estimator.config.schema import Estimator
from estimator.device.lifecycle import Event
from estimator.device.outcome import Outcome
from estimator.device.prior_knowledge import PriorKnowledge
from estimator.device.restore_key import changed
from estimator.samples.sample_buffer import Samples
from estimator.service.boot_start import Boots
from estimator.service.checkpoints import calibrated
from estimator.service.cluster import Cluster
from estimator.service.command_handling import CommandHandler
from estimator.service.commands import Commands
from estimator.service.device import NEWCOMER_S, Device
from estimator.service.device_loss import SILENT, DeviceLoss
from estimator.service.device_roster import DeviceRoster
from estimator.service.enrolment_gate import EnrolmentGate, Notices
from estimator.service.fault_isolation import FaultIsolation
from estimator.service.health import ServiceHealth
from estimator.service.intake import Intake
from estimator.service.newcomers import FORGET_S, Newcomers
from estimator.service.overload import OVERLOADED, Overload
from estimator.service.periodic_checks import PeriodicChecks, Totals
from estimator.service.presence import Presence
from estimator.service.quota import FLOODED, Quotas
from estimator.service.replay_log import Resumed, since
from estimator.service.store import Store
from estimator.service.store_access import StoreAccess
from estimator.service.store_writer import StoreWriter
from estimator.service.window_views import WindowViews

log = logging.getLogger(__name__)

STATUS_S = 1.0
#: most messages that the bus queues for us, and that are read in one round
QUEUE = 65536
#: longest time per round for learning and once-a-second work, s, so that samples do not wait for all devices
WORK_S = 0.01
#: a round longer than this is not counted as silence of any device, s
SLOW_S = 0.5
#: how long the last samples are still corrected after a stop request, s
DRAIN_S = 2.0
#: past messages per device requested from bridges beside other estimators: 10 s of 50 ms, more than a checkpoint's age
PAST_IN_COMPANY = 200
#: how long publishers of a device lost to another estimator stay open for late queries, s
LINGER_S = 40.0


class Service:
    """Running estimator on a session of the bus.

    peers: ids of other estimators of the ward that were seen already.
    """

    def __init__(
        self,
        ward: str,
        settings: Estimator,
        bus: Bus,
        store: Store,
        now_ns: Callable[[], int] = time.time_ns,
        vitals: ServiceHealth | None = None,
        clerk: StoreWriter | None = None,
        enrolment: Enrolment | None = None,
        peers: Collection[str] = (),
    ) -> None:
        self.ward, self.settings = ward, settings
        self.counts = Tally()
        self._bus, self._now_ns, self._store_path = bus, now_ns, store.path
        self._cluster = Cluster(ward, settings.id, bus, now_ns, self.counts, peers)
        membership = self._cluster.membership
        self._guarded = FaultIsolation(self.counts)
        self._record = StoreAccess(
            store,
            self.counts,
            now_ns,
            clerk,
            self._cluster.replicas,
            self._cluster.tell,
            lambda: membership.highest,
            self._guarded,
        )
        membership.hear(self._record.epoch())
        self._left = deque[tuple[float, Publisher]]()
        #: calibrations of another estimator, to be adopted once their device is heard again
        self._missed = dict[str, Checkpoint]()
        self._treatment = treatment(settings)
        self._devices = DeviceRoster(self.counts, settings.silence_s)
        self._resumed = Resumed(self._record.reached(), time.monotonic())
        self._stock = PeriodicChecks(self._devices, self.counts, vitals or ServiceHealth())
        self._boots = Boots(self._devices, self._record, self._guarded)
        self._intake = Intake(
            self._devices,
            self._boots,
            self._stock,
            self._guarded,
            self._resumed,
            self.counts,
            self._tell,
            self._newcomer,
        )
        self._presence, self._views = Presence(self.counts), WindowViews(self.counts)
        self._gate = EnrolmentGate(enrolment, self.counts)
        self._notices = Notices(bus, ward, self._gate)
        self._newcomers = None if enrolment is not None else Newcomers(self._is_known, self.counts)
        self._quotas = Quotas(self._flooded, time.monotonic)
        self._overload = Overload(time.monotonic())
        self._lost = DeviceLoss(self._presence, self._gate, self._quotas, settings.silence_s)
        #: devices with a block to learn from, and devices due for the once-a-second work, in order
        self._to_learn, self._to_look = dict[str, None](), dict[str, None]()
        self._orders = CommandHandler(self._devices, self._record, self._gate, self._guarded, self.counts, now_ns)
        self._commands = Commands(self._cluster.answers, lambda reason: self.counts.add(f"commands {reason}"))
        self._next_status, self._looked = 0.0, time.monotonic()
        self._router = RouterWatch(log, STATUS_S, vitals.routers if vitals else None)
        # The full past would delay an estimator beside others, and they have corrected it.
        past = PAST_IN_COMPANY if peers else None
        self._raw = bus.subscribe(keys.pattern(ward, "raw"), history=True, capacity=QUEUE, most_past=past)
        self._cluster.on_token = self._raw.wake
        self._info = bus.subscribe(keys.pattern(ward, "info"), history=True, prompt=False)
        self._totals = Totals()
        self._declared = [
            bus.answer(keys.pattern(ward, "rpc"), self._commands.ask),
            bus.declare_alive(keys.build(ward, "alive/estimator", estimator=settings.id)),
            bus.watch_alive(keys.pattern(ward, "alive/device"), self._presence.change),
            bus.watch_alive(keys.pattern(ward, "alive/bridge"), self._presence.change),
        ]

    def run(self, stop: threading.Event) -> None:
        """Serve until stopped; then correct the last samples, store the biases and withdraw the liveliness tokens."""
        log.info("estimator %s serves ward %s, store %s", self.settings.id, self.ward, self._store_path)
        while not stop.is_set():
            self.step(0.05)
        deadline = time.monotonic() + DRAIN_S
        while self.step(0.0) and time.monotonic() < deadline:
            pass
        self._intake.give_up()
        self.work()
        now = time.monotonic()
        for device in self._devices.values():
            self._guarded(device, partial(self._record.checkpoint, device, now, force=True, whole=True))
        self._record.close()
        self._totals.tell(now, self._count_all(), last=True)
        for _, publisher in self._left:
            publisher.close()
        for thing in (
            *self._declared,
            self._cluster,
            self._raw,
            self._info,
            self._notices,
            *self._devices.values(),
        ):
            thing.close()
        log.info("estimator %s stopped", self.settings.id)

    def step(self, timeout_s: float) -> int:
        """Run one round: samples, commands and due work. Returns how many sample messages arrived or still wait."""
        waits = time.monotonic()
        hurry = len(self._quotas) > 0 or bool(self._to_learn) or bool(self._to_look)
        messages = self._raw.drain(QUEUE, 0.0 if hurry else timeout_s)
        began = time.monotonic()
        self._overload.idle(began - waits)
        for message in self._gate.admit(self._info.drain(512, 0.0), began):
            self._intake.hear(message)
        messages = self._gate.admit(messages, began)
        if self._newcomers is not None:
            messages = self._newcomers.admit(messages, began)
        self._intake.take(self._quotas.round(self._ours(messages, began)))
        self._commands.work(self._orders.do)
        now = time.monotonic()
        self._record.collect(now)
        self._intake.give_up(now, self._quotas)
        self._views.say(now)
        if now - began > SLOW_S:
            for device in self._devices.values():
                # Messages that arrived meanwhile still wait, so our own slowness is no silence. Never later than now.
                device.heard = min(device.heard + now - began, now)
        if now >= self._next_status:
            self._next_status = now + STATUS_S
            self._every_second(now)
        self._cluster.say(self._devices, now)
        self.work(now + WORK_S)
        return len(messages) + len(self._quotas)

    def work(self, until: float = math.inf) -> None:
        """Learn from blocks and do the devices' once-a-second work until a monotonic time; the rest waits."""
        for waiting, do in ((self._to_learn, self._learn), (self._to_look, self._look_after)):
            while waiting:
                if (device := self._devices.get(name := next(iter(waiting)))) is not None:
                    do(device)
                waiting.pop(name, None)
                if time.monotonic() >= until:
                    return

    # ---- several estimators ---------------------------------------------------------------------------------------

    def _ours(self, messages: Sequence[Message], now: float) -> Sequence[Message]:
        """Give up and take over devices; returns the messages of our devices, with the backlog of new ones."""
        if lost := self._cluster.look(now, heard=bool(messages)):
            self._give_away(lost, now)
        if self._cluster.newcomer():
            for device in self._devices.values():
                device.checkpoint_due = now  # the newcomer holds off until it has heard of all devices
        for known in self._cluster.calibrated():
            self._adopt(known)
        ours, taken = self._cluster.sift(messages, now)
        if taken:
            self._cluster.say(self._devices, now)
        for name, backlog in taken.items():
            self._take_over(name, now)
            going_on = self._devices.get(name)
            if going_on is None:
                ours += backlog
            elif backlog:
                ours += since(backlog, going_on.session.boot or 0, going_on.session.sequence.next or 0)
            else:
                going_on.session.silence(SILENT)
        return ours

    def _give_away(self, names: list[str], now: float) -> None:
        """Release devices taken by another estimator, which continues from our checkpoint."""
        self._quotas.drop(names)  # the new owner has these messages in its replay log
        leaving = [device for name in names if (device := self._devices.get(name)) is not None]
        for device in leaving:
            self._missed.pop(device.name, None)
            self._intake.leave(device)
            self._learn(device)
            self._guarded(device, partial(self._record.checkpoint, device, now, force=True))
        self._stock.check()  # while the devices still count
        for device in leaving:
            self._stock.leave(device.name)
            del self._devices[device.name]
            self._left += [(now + LINGER_S, publisher) for publisher in device.leave()]

    def _take_over(self, name: str, now: float) -> None:
        """Take over a device from its checkpoint; without a usable one the device starts with its first sample."""
        known = self._cluster.replicas.of(name)
        if known is None or not known.state or not self._devices.room(now, 0):
            return
        device = self._made(name, now)
        if self._record.holds(device, known) and self._goes_on(device, known):
            device.heard = now - max(0.0, (self._now_ns() - known.time_ns) / 1e9)
            if known.bridge:
                device.admission.source.owns(known.bridge, device.heard)
            self._devices[name] = device
            self._guarded(device, self._resume, device)

    def _goes_on(self, device: Device, known: Checkpoint) -> bool:
        """Whether a device continues from a checkpoint; a damaged checkpoint changes nothing and is counted."""
        try:
            device.take_over(known)
        except Exception as error:  # noqa: BLE001 - a checkpoint may hold anything, and all devices are at stake
            log.warning("%s: its checkpoint is not used: %s", device.name, error)
            self.counts.add("checkpoint messages refused, damaged")
            return False
        return True

    def _resume(self, device: Device) -> None:
        used = device.session.calibration
        log.info("%s: %s of this boot restored", device.name, "bias" if used is None else f"calibration {used.id}")
        if (outcome := self._boots.resumed(device)) is not None:
            self._tell(device, outcome)

    def _made(self, name: str, now: float, began: float = 0.0) -> Device:
        """Create a device owned by us. began: device time in s of the start of its boot, if known."""
        knobs, epoch = self._treatment.of(name), self._cluster.epoch(name)
        device = Device(self._bus, self.ward, name, knobs, self.settings.silence_s, now, epoch, began)
        if self._cluster.replicas.of(name) is not None:
            device.announced_at = 0
        elif self._newcomers is not None and not self._record.knows(name):
            device.announced_after_s = NEWCOMER_S
        return device

    def _adopt(self, known: Checkpoint) -> None:
        """Adopt a calibration that another estimator made during a network partition, so that no turns are repeated."""
        device, calibration = self._devices.get(known.device), calibrated(known)
        if device is None or calibration is None:
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
            return  # invalidated since then

        def adopted() -> None:
            device.repeated = None
            session.adopt(PriorKnowledge(calibration, None), calibration)
            log.info("%s: %s", device.name, english(*session.life.reason))
            self._record.keep(device, calibration)
            device.say_status(self._now_ns())

        self._guarded(device, adopted)

    # ---- what comes in --------------------------------------------------------------------------------------------

    def _newcomer(self, batch: Samples, now: float) -> Device | None:
        """Create a device from its first batch; None where there is no room.

        The bridge known to another estimator, or from before a restart, becomes the owner. Beside other estimators no
        sample before this batch is waited for. A boot stopped in order is resumed.
        """
        if not self._devices.room(now, batch.n):
            return None
        name = batch.device
        device = self._made(name, now, batch.first_s)
        lately = self._cluster.replicas.lately_from(name, self._now_ns())
        if known := lately or self._resumed.bridge(name, batch.receive_time_ns):
            device.admission.source.owns(known, now)
        if self._cluster.company:
            device.admission.begin_at(batch.sequence)
        self._devices[name] = device
        if (stopped := self._record.stopped(name, batch.boot)) is not None and self._goes_on(device, stopped):
            self._resume(device)
        return device

    def _is_known(self, name: str) -> bool:
        return name in self._devices or self._cluster.replicas.of(name) is not None or self._record.knows(name)

    def _forget_strangers(self, now: float) -> None:
        if self._newcomers is not None:
            self._devices.forget(now, FORGET_S)
            self._newcomers.look(now, kept=self._devices.__contains__, proven=self._devices.proven)

    def _flooded(self, key: str, messages: int) -> None:
        self.counts.add(FLOODED, messages)
        device = self._devices.get(key.rpartition("/")[2])
        if device is not None and device.session.sequence.events.add(FLOODED, messages) == messages:
            log.warning("%s: sends more than can be handled; the oldest is dropped (more is only counted)", device.name)

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
            device.say_status(self._now_ns())
            if device.session.learnt.turned:
                self._cluster.tell(device)  # the other estimators must know that turns would be lost with us
        if device.session.to_learn:
            self._to_learn[device.name] = None

    def _every_second(self, now: float) -> None:
        self._stock.check()
        self._gate.look(now)
        self._forget_strangers(now)
        self._notices.say(self._now_ns(), self._devices)
        while self._left and self._left[0][0] <= now:
            self._left.popleft()[1].close()
        self._presence.note(now)
        connected = self._bus.connected
        if not connected:
            self._presence.forget()
        if self._router.look(now, connected=connected):
            for device in self._devices.values():  # the router is gone: unknown, not lost
                # The outage neither ends nor extends the silence of a device that was silent before.
                was_silent = now - device.heard > self.settings.silence_s + STATUS_S
                device.heard = min(now, device.heard + now - self._looked) if was_silent else now
                device.admission.source.hold(now)
                if not connected:
                    device.session.silence((Code.ROUTER_GONE(),), Event.UNREACHABLE)
        self._looked = now
        waited_s = self._quotas.typical_wait_s(len(self._devices))
        over_s = self._overload.look(now, waited_s=waited_s)
        if over_s:
            self.counts.add(f"{OVERLOADED}, seconds")
        for device in self._devices.values():
            device.overloaded_s, device.unkept = over_s, bool(self._record.trouble)
        self._to_look |= dict.fromkeys(self._devices)
        self._cluster.look_round(now, self._devices.keys() | self._quotas.devices())
        self._record.tend(now)
        counts = self._count_all()
        self._totals.tell(now, counts)
        self._stock.note(now, self._record.trouble, counts, connected=connected, busy=self._overload.busy)

    def _look_after(self, device: Device) -> None:
        self._guarded(device, self._looked_after, device, time.monotonic())

    def _looked_after(self, device: Device, now: float) -> None:
        if (missed := self._missed.pop(device.name, None)) is not None:
            self._adopt(missed)
        self._lost.look(device, now)
        device.say_status(self._now_ns())
        self._stock.see(device)
        device.look_round()
        self._record.checkpoint(device, now)

    def _count_all(self) -> dict[str, int]:
        missed = {"sample messages missed": self._raw.missed, "info messages missed": self._info.missed}
        met = self._intake.refused() | self._cluster.refused() | self.counts.as_dict()
        return met | {label: n for label, n in missed.items() if n}
