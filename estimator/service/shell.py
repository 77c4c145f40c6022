"""The estimator as a service: the only thread that touches sessions and store, between the bus and the pure cores."""

import logging
import threading
import time
from collections.abc import Callable

from bridge.bus.contract import Bus, Publisher
from bridge.wire import codec, keys
from bridge.wire.messages import Calibration, Command, CommandReply, DeviceInfo, SampleBatch, Verdict
from bridge.wire.refusal import Tally
from estimator.config import Estimator
from estimator.door import Door
from estimator.service.commands import Commands
from estimator.service.store import Store, StoreError
from estimator.session import DeviceSession, Outcome, Remembered, SessionKnobs

log = logging.getLogger(__name__)

MAX_DEVICES = 4096
STATUS_S, CHECKPOINT_S, HISTORY_S = 1.0, 5.0, 60.0
#: how long the last samples are corrected after a stop was asked for
DRAIN_S = 2.0
#: messages kept for late and returning subscribers: some 15 s of corrected rates
CORRECTED_CACHE, CALIBRATION_CACHE = 512, 8


class _Device:
    """A session and its publishers."""

    def __init__(self, bus: Bus, ward: str, device: str, knobs: SessionKnobs) -> None:
        self.session = DeviceSession(device, knobs)
        self.heard = time.monotonic()
        self.corrected = bus.publisher(keys.build(ward, "corrected", device=device), cache=CORRECTED_CACHE)
        self.status = bus.publisher(keys.build(ward, "status", device=device), cache=1)
        self.calibration = bus.publisher(keys.build(ward, "calibration", device=device), cache=CALIBRATION_CACHE)
        self.checkpointed = self.recorded = 0.0

    def publishers(self) -> tuple[Publisher, ...]:
        return self.corrected, self.status, self.calibration


class Service:
    """A running estimator. Samples and results go over `data`; commands and liveliness over `control`, its own session."""

    def __init__(
        self,
        ward: str,
        settings: Estimator,
        data: Bus,
        control: Bus,
        store: Store,
        now_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self.ward, self.settings = ward, settings
        self.counts = Tally()
        self._bus, self._control, self._store, self._now_ns = data, control, store, now_ns
        self._knobs = SessionKnobs(method=settings.method, warming_s=settings.warming_s)
        self._devices: dict[str, _Device] = {}
        self._infos: dict[str, DeviceInfo] = {}
        self._samples = Door[SampleBatch]("sample", codec.decode_samples)
        self._info_door = Door[DeviceInfo]("info", codec.decode_info)
        self._commands = Commands()
        self._next_status = 0.0
        self._connected = True
        self._raw = data.subscribe(keys.pattern(ward, "raw"), history=True)
        self._info = data.subscribe(keys.pattern(ward, "info"), history=True)
        self._declared = [
            control.answer(keys.pattern(ward, "rpc"), self._commands.ask),
            control.declare_alive(keys.build(ward, "alive/estimator", estimator=settings.id)),
        ]

    def run(self, stop: threading.Event) -> None:
        """Serve until stopped, then say goodbye: the last samples are corrected, the bias kept, the tokens taken back."""
        log.info("estimator %s serves ward %s, store %s", self.settings.id, self.ward, self._store.path)
        while not stop.is_set():
            self.step(0.05)
        deadline = time.monotonic() + DRAIN_S
        while self.step(0.0) and time.monotonic() < deadline:
            pass
        for device in self._devices.values():
            self._checkpoint(device, time.monotonic(), force=True)
        for thing in (
            *self._declared,
            self._raw,
            self._info,
            *(p for d in self._devices.values() for p in d.publishers()),
        ):
            thing.close()
        log.info("estimator %s stopped", self.settings.id)

    def step(self, timeout_s: float) -> int:
        """One round: what has come in, what was asked, what is due. How many sample messages came."""
        messages = self._raw.drain(512, timeout_s)
        for message in self._info.drain(512, 0.0):
            info = self._info_door.take(message)
            if info is not None:
                self._on_info(info)
        for message in messages:
            batch = self._samples.take(message)
            if batch is not None:
                self._on_samples(batch)
        self._commands.work(self._do)
        now = time.monotonic()
        if now >= self._next_status:
            self._next_status = now + STATUS_S
            self._every_second(now)
        return len(messages)

    def _on_info(self, info: DeviceInfo) -> None:
        new = info.device not in self._infos or self._infos[info.device].boot != info.boot
        if new and len(self._infos) >= MAX_DEVICES:
            self.counts.add("too many devices")
            return
        self._infos[info.device] = info
        device = self._devices.get(info.device)
        if device is None or device.session.boot != info.boot:
            return
        device.session.info = info
        if new:
            self._keep(device.session, lambda: self._store.add_boot(info, self._now_ns()))
            if (calibration := self._prior(device.session, info)) is not None:
                device.session.believe(calibration)

    def _on_samples(self, batch: SampleBatch) -> None:
        device = self._devices.get(batch.device)
        if device is None:
            if len(self._devices) >= MAX_DEVICES:
                self.counts.add("too many devices")
                return
            device = self._devices[batch.device] = _Device(self._bus, self.ward, batch.device, self._knobs)
        device.heard = time.monotonic()
        if device.session.sequence.is_new_boot(batch.boot):
            self._tell(device, self._boots(device.session, batch))
        self._tell(device, device.session.handle(batch))

    def _boots(self, session: DeviceSession, batch: SampleBatch) -> Outcome:
        info = self._infos.get(batch.device)
        session.info = info if info is not None and info.boot == batch.boot else None
        remembered = None
        try:
            remembered = self._store.recall(batch.device, batch.boot)
        except StoreError as error:
            self._store_failed(session, error)
        if session.info is not None:
            boot_info = session.info
            self._keep(session, lambda: self._store.add_boot(boot_info, self._now_ns()))
            if remembered is None and (calibration := self._prior(session, boot_info)) is not None:
                remembered = Remembered(calibration, None)
        return session.begin_boot(batch.boot, float(batch.device_time[0]), remembered)

    def _prior(self, session: DeviceSession, info: DeviceInfo) -> Calibration | None:
        try:
            return self._store.prior(info)
        except StoreError as error:
            self._store_failed(session, error)
            return None

    def _tell(self, device: _Device, outcome: Outcome) -> None:
        session = device.session
        for words in outcome.said:
            log.info("%s: %s", session.device, words)
        if outcome.calibration is not None:
            self._calibrated(device, outcome.calibration)
        for batch in outcome.corrected:
            device.corrected.put(codec.encode_corrected(batch))
        if outcome.changed:
            device.status.put(codec.encode_status(session.status(self._now_ns())))

    def _calibrated(self, device: _Device, calibration: Calibration) -> None:
        c = calibration
        if c.verdict is Verdict.ACCEPTED:
            self._keep(device.session, lambda: self._store.add_calibration(c))
        else:
            verdict = f"{c.verdict.name.lower()}: {c.reason}"
            self._keep(
                device.session,
                lambda: self._store.add_audit(
                    self._now_ns(), c.device, "calibrate", c.id, c.who, "", verdict, accepted=False
                ),
            )
        device.calibration.put(codec.encode_calibration(c))
        self._checkpoint(device, time.monotonic(), force=True)

    def _every_second(self, now: float) -> None:
        connected = self._bus.connected
        if connected != self._connected:
            log.log(
                *(
                    (logging.INFO, "the router is back")
                    if connected
                    else (logging.WARNING, "the router is gone; waiting")
                )
            )
        if not connected or connected != self._connected:
            for device in self._devices.values():  # nothing can be heard: unknown, not lost
                device.heard = now
        self._connected = connected
        for device in self._devices.values():
            session = device.session
            silent_s = now - device.heard
            if silent_s > self.settings.silence_s and session.silence(f"no samples for {silent_s:.0f} s"):
                log.warning("%s: lost, no samples for %.1f s", session.device, silent_s)
            device.status.put(codec.encode_status(session.status(self._now_ns())))
            self._checkpoint(device, now)

    def _checkpoint(self, device: _Device, now: float, *, force: bool = False) -> None:
        state, boot = device.session.checkpoint(), device.session.boot
        if state is None or boot is None or (now - device.checkpointed < CHECKPOINT_S and not force):
            return
        device.checkpointed = now
        history = now - device.recorded >= HISTORY_S
        if history:
            device.recorded = now
        name, time_ns = device.session.device, self._now_ns()
        self._keep(device.session, lambda: self._store.save_bias(name, boot, time_ns, state, history=history))

    def _do(self, key: keys.Key, command: Command) -> CommandReply:
        verb = key.ids["verb"]
        device = self._devices.get(key.device)
        if device is None:
            known = ", ".join(sorted(self._devices)) or "none"
            return self._reply(key, command, f"no device {key.device} was heard; there are: {known}")
        session = device.session
        if verb == "recalibrate":
            refusal = session.recalibrate(command.who, command.reason)
        elif verb == "cancel":
            refusal = session.cancel(command.who)
        else:
            refusal = None if command.reason else "a note needs a text, in `reason`"
        device.status.put(codec.encode_status(session.status(self._now_ns())))
        return self._reply(key, command, refusal, session)

    def _reply(
        self, key: keys.Key, command: Command, refusal: str | None, session: DeviceSession | None = None
    ) -> CommandReply:
        message = refusal or (session.reason if session and key.ids["verb"] != "note" else "noted")
        log.info("%s: %s by %s: %s", key.device, key.ids["verb"], command.who, message)
        try:
            self._store.add_audit(
                self._now_ns(),
                key.device,
                key.ids["verb"],
                command.request_id,
                command.who,
                command.reason,
                message,
                accepted=refusal is None,
            )
        except StoreError as error:
            self.counts.add("store failed")
            log.error("%s", error)
        return CommandReply(command.request_id, accepted=refusal is None, message=message)

    def _keep(self, session: DeviceSession, write: Callable[[], None]) -> None:
        try:
            write()
        except StoreError as error:
            self._store_failed(session, error)

    def _store_failed(self, session: DeviceSession, error: StoreError) -> None:
        self.counts.add("store failed")
        if session.count_event("store failed") == 1:
            log.error("%s; %s goes on from memory", error, session.device)
