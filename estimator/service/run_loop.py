"""Run loop of the estimator: one thread that reads the bus, processes samples and commands, and publishes.

Only this thread changes the devices' sessions.
"""

import logging
import math
import threading
import time
from collections.abc import Callable, Collection
from functools import partial

from bridge.bus.contract import Bus
from bridge.bus.router_watch import RouterWatch
from bridge.bus.routers import Routers
from bridge.config.enrolment import Enrolment
from bridge.config.ward_file import WardFile
from bridge.reasons.codes import Code
from bridge.wire import keys
from bridge.wire.messages import Placement
from bridge.wire.refusal import Tally
from estimator.alerts.board import Change
from estimator.config.alerts import DEFAULTS, Alerts
from estimator.config.schema import Estimator, Ward
from estimator.device.lifecycle import Event
from estimator.service.boot_start import Boots
from estimator.service.cluster import Cluster
from estimator.service.commands import Commands
from estimator.service.device import Device
from estimator.service.device_loss import DeviceLoss
from estimator.service.device_roster import DeviceRoster
from estimator.service.device_start import DeviceStarts
from estimator.service.enrolment_gate import EnrolmentGate, Notices
from estimator.service.entrance import Entrance, Newcomers
from estimator.service.forgetting import Forgetting
from estimator.service.health import ServiceHealth
from estimator.service.intake import Intake
from estimator.service.outcomes import Outcomes
from estimator.service.overload import OVERLOADED, UNKEPT, Overload
from estimator.service.own_alerts import OwnAlerts
from estimator.service.parts import Parts
from estimator.service.periodic_checks import PeriodicChecks
from estimator.service.presence import Presence
from estimator.service.quota import FLOODED, Quotas
from estimator.service.replay_log import Resumed
from estimator.service.store import Store
from estimator.service.store_access import StoreAccess
from estimator.service.store_care import StoreCare
from estimator.service.store_writer import StoreWriter
from estimator.service.takeover import Takeover

log = logging.getLogger(__name__)

#: interval of the once-a-second work and of statuses, s
STATUS_S = 1.0
#: most messages that the bus queues for us, and that are read in one round
QUEUE = 65536
#: longest time per round for learning and once-a-second work, s, so that samples do not wait for all devices
WORK_S = 0.01
#: how long the last samples are still corrected after a stop request, s
DRAIN_S = 2.0
#: past messages per device requested from bridges beside other estimators: 10 s of 50 ms, more than a checkpoint's age
PAST_IN_COMPANY = 200
#: a device of the last run that is not heard for this long after a start is missing, s
MISSING_S = 10.0


class Service:
    """Running estimator of a ward on a session of the bus.

    now_ns: the host's clock, ns since the Unix epoch. vitals: receives the health snapshots. clerk: the store's thread.
    enrolment: the `[devices]` table of the ward file; None admits every device. peers: ids of other estimators of the
    ward seen before. file: the ward file, which may change.
    send(subject, placement, change): receives alerts and all-clears for people. sends(alerts): receives changed
    settings of alerts. copies_fail(): whether copying backups failed.
    """

    def __init__(
        self,
        ward: str,
        settings: Estimator,
        bus: Bus,
        store: Store,
        now_ns: Callable[[], int] = time.time_ns,
        *,
        vitals: ServiceHealth | None = None,
        clerk: StoreWriter | None = None,
        enrolment: Enrolment | None = None,
        peers: Collection[str] = (),
        file: WardFile[Ward] | None = None,
        alerts: Alerts = DEFAULTS,
        send: Callable[[str, Placement | None, Change], None] = lambda *_: None,
        sends: Callable[[Alerts], None] = lambda _: None,
        copies_fail: Callable[[], bool] = lambda: False,
    ) -> None:
        self.ward, self.settings, self._file = ward, settings, file
        self.counts = Tally()
        self._bus, self._now_ns = bus, now_ns
        self._cluster = Cluster(ward, settings.id, bus, now_ns, self.counts, peers)
        self._devices = DeviceRoster(self.counts, settings.silence_s)
        self._store, self._clerk = store, clerk or StoreWriter(store.database, thread=False)
        self._care = StoreCare(store, now_ns, self._clerk)
        self._record = StoreAccess(
            store, self.counts, now_ns, self._clerk, self._cluster.replicas, self._cluster.tell, self._devices.guard
        )
        self._cluster.membership.hear(store.epoch())
        self._send, self._sends = send, sends
        now = time.monotonic()
        standing = self._record.standing(settings.id)
        routers = vitals.routers if vitals else Routers(())
        self._own_alerts = OwnAlerts(
            settings.id, alerts, store.database, routers, self._alerted, standing, now, self._clerk.look_up, copies_fail
        )
        parts = Parts(ward, settings, bus, now_ns, self.counts, self._devices, self._cluster, self._record, {})
        self._troubles = parts.troubles
        resumed = Resumed(self._record.reached(), now)
        self._stock = PeriodicChecks(self._devices, self.counts, vitals or ServiceHealth())
        boots = Boots(parts)
        self._outcomes = Outcomes(parts)
        self._starts = DeviceStarts(parts, boots, resumed, self._outcomes.tell, alerts, listed=enrolment is not None)
        self._missing_s = now + MISSING_S
        self._intake = Intake(parts, boots, self._stock, resumed, self._outcomes.tell, self._starts)
        self._presence = Presence(self.counts)
        self._gate = EnrolmentGate(enrolment, self.counts)
        self._notices = Notices(bus, ward, self._gate)
        newcomers = None if enrolment is not None else Newcomers(self._is_known, self.counts)
        self._entrance = Entrance(self._gate, newcomers, self._cluster)
        self._quotas = Quotas(self._flooded)
        self._takeover = Takeover(parts, self._starts, self._stock, self._quotas, self._outcomes.learn)
        self._overload = Overload(now)
        self._lost = DeviceLoss(self._devices, self._presence, self._gate, self._quotas, settings.silence_s)
        #: devices due for the once-a-second work, in order
        self._to_look = dict[str, None]()
        self._forgetting = Forgetting(parts, self._gate, self._presence, self._stock)
        self._commands = Commands(parts, self._gate, self._own_alerts, self._forgetting)
        #: when the present round began, when the last once-a-second work did, and when the next is due
        self._began, self._looked, self._next_status = now, now, 0.0
        self._router = RouterWatch(log, vitals.routers if vitals else None)
        # The full past would delay an estimator beside others, and they have corrected it.
        past = PAST_IN_COMPANY if peers else None
        self._raw = bus.subscribe(keys.pattern(ward, "raw"), history=True, capacity=QUEUE, most_past=past)
        self._info = bus.subscribe(keys.pattern(ward, "info"), history=True, prompt=False)
        self._declared = [
            bus.answer(keys.pattern(ward, "rpc"), self._commands.ask),
            bus.declare_alive(keys.build(ward, "alive/estimator", estimator=settings.id)),
            bus.watch_alive(keys.pattern(ward, "alive/device"), self._presence.change),
            bus.watch_alive(keys.pattern(ward, "alive/bridge"), self._presence.change),
        ]

    def run(self, stop: threading.Event) -> None:
        """Serve until `stop` is set; then correct the last samples, store the biases and close all connections."""
        log.info("estimator %s serves ward %s, store %s", self.settings.id, self.ward, self._store.path)
        while not stop.is_set():
            self.step(0.05)
        deadline = time.monotonic() + DRAIN_S
        while self.step(0.0) and time.monotonic() < deadline:
            pass
        self.work()
        now = time.monotonic()
        for device in self._devices.values():
            self._devices.guard(device, partial(self._record.checkpoint, device, now, force=True, whole=True))
        self._clerk.close()
        self._stock.log(now, self._count_all(), last=True)
        self._takeover.tidy(math.inf)
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
        """Run one round of the loop: process samples, commands, and periodic work that is due.

        timeout_s: longest wait for a sample message, s.
        Returns the number of sample messages received in this round plus the number still queued after it.
        """
        waits = time.monotonic()
        hurry = len(self._quotas) > 0 or bool(self._outcomes.to_learn) or bool(self._to_look)
        messages = self._raw.drain(QUEUE, 0.0 if hurry else timeout_s)
        self._began = began = time.monotonic()
        self._overload.idle(began - waits)
        for message in self._entrance.enrolled(self._info.drain(512, 0.0), began):
            self._intake.hear(message)
        self._takeover.look(began, heard=bool(messages))
        ours, others = self._entrance.sort(messages, began)
        ours += self._takeover.take(others, began)
        self._intake.take(self._quotas.round(ours))
        self._commands.work()
        now = time.monotonic()
        if self._file and (new := self._file.look(now)):
            self._take_settings(new)
        self._record.collect(now)
        self._outcomes.say_windows()
        if now >= self._next_status:
            self._next_status = now + STATUS_S
            self._every_second(now)
        self._cluster.say(self._devices, now)
        self.work(now + WORK_S)
        return len(messages) + len(self._quotas)

    def work(self, until: float = math.inf) -> None:
        """Update estimates from finished blocks of samples, and do the once-a-second work of devices.

        It includes: detect a lost device, raise and clear alerts, publish the status, publish and store checkpoints.
        until: monotonic time, s, at which the work pauses; the rest waits for the next call.
        """
        for waiting, do in ((self._outcomes.to_learn, self._outcomes.learn), (self._to_look, self._look_after)):
            while waiting:
                if (device := self._devices.get(name := next(iter(waiting)))) is not None:
                    self._devices.guard(device, do, device)
                waiting.pop(name, None)
                if time.monotonic() >= until:
                    return

    def _take_settings(self, ward: Ward) -> None:
        """Use the changed settings: enrolment and alerts at once, others from a device's next boot on."""
        if ward.devices is not None:
            self._gate.enrol(ward.devices)
        if ward.estimator is not None:
            self._starts.use(ward.estimator, ward.alerts)
        self._own_alerts.board.settings = ward.alerts
        self._sends(ward.alerts)

    # ---- what comes in --------------------------------------------------------------------------------------------

    def _is_known(self, name: str) -> bool:
        return name in self._devices or self._cluster.replicas.of(name) is not None or self._record.knows(name)

    def _flooded(self, key: str, messages: int) -> None:
        self.counts.add(FLOODED, messages)
        device = self._devices.get(key.rpartition("/")[2])
        if device is not None and device.session.sequence.events.add(FLOODED, messages) == messages:
            log.warning(
                "%s sends too many messages: the oldest are dropped (further drops are counted, not logged)",
                device.name,
            )

    # ---- what goes out --------------------------------------------------------------------------------------------

    def _every_second(self, now: float) -> None:
        self._stock.check()
        self._entrance.look(now, self._devices)
        self._forgetting.look(now)
        self._notices.say(self._now_ns(), self._devices)
        self._takeover.tidy(now)
        self._presence.note(now)
        connected = self._bus.connected
        if not connected:
            self._presence.forget()
        if self._router.look(now, connected=connected):
            self._excuse(now, connected=connected)
        if connected and now >= self._missing_s:
            self._starts.miss(now, lambda name: not self._gate.why(name))
            self._missing_s = math.inf
        self._looked = now
        over_s = self._overload.look(now)
        if over_s:
            self.counts.add(f"{OVERLOADED}, seconds")
        self._troubles |= {OVERLOADED: over_s, UNKEPT: int(bool(self._record.trouble))}
        self._to_look |= dict.fromkeys(self._devices)
        self._cluster.look_round(now, self._devices.keys() | self._quotas.devices())
        self._care.tend(now, self._cluster.membership.highest)
        self._own_alerts.look(now, self._now_ns())
        self._cluster.alerts = self._own_alerts.board.standing
        counts = self._count_all()
        kinds = tuple(one.kind for one in self._cluster.alerts)
        self._stock.note(now, self._record.trouble, counts, connected=connected, busy=self._overload.busy, alerts=kinds)

    def _excuse(self, now: float, *, connected: bool) -> None:
        """While the router is away the devices' state is unknown: nothing could be heard of them."""
        for device in self._devices.values():
            # The outage neither ends nor extends the silence of a device that was silent before.
            was_silent = now - device.heard > self.settings.silence_s + STATUS_S
            device.heard = min(now, device.heard + now - self._looked) if was_silent else now
            device.admission.hold(now)
            if not connected:
                device.session.silence((Code.ROUTER_GONE(),), Event.UNREACHABLE)

    def _look_after(self, device: Device) -> None:
        now = time.monotonic()
        self._lost.look(device, self._began)  # what came since waits for the next round
        for change in device.look_for_alerts(now, self._now_ns()):
            self._record.alert(device.name, change)
            self._send(device.name, device.placement, change)
        device.say_status(self._now_ns())
        self._stock.see(device)
        device.look_round()
        self._record.checkpoint(device, now)

    def _alerted(self, change: Change) -> None:
        """Store a change of the estimator's own alerts, and send it unless a person made it."""
        self._record.alert(self.settings.id, change)
        if change.cleared or not change.alert.acknowledged_ns:
            self._send(self.settings.id, None, change)

    def _count_all(self) -> dict[str, int]:
        missed = {"sample messages missed": self._raw.missed, "info messages missed": self._info.missed}
        missed |= {
            "store failed": self._store.database.failures,
            "damage in the store": len(self._store.database.notes),
        }
        return self.counts.as_dict() | {label: n for label, n in missed.items() if n}
