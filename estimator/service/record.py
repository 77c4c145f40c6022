"""The store as the service uses it: what fails is counted and gone on without; calibrations wait and are tried again.

The first failure is told aloud, those after it are counted, and that it works again is told.
"""

import logging
from collections.abc import Callable

from bridge.wire import codec, keys
from bridge.wire.messages import Calibration, Command, CommandReply, DeviceInfo, Verdict
from bridge.wire.refusal import Refusal, Tally
from estimator.restore import changed
from estimator.service.device import UNSAVED, Device
from estimator.service.store import Store, StoreError
from estimator.session import DeviceSession, Remembered
from estimator.track.learning import learn
from estimator.track.temperature import TemperatureLaw

log = logging.getLogger(__name__)

CHECKPOINT_S, HISTORY_S = 5.0, 60.0
#: how often a device's bias history is looked through for what is too old to be kept so densely
THIN_S = 86400.0
#: what a history says where nothing known of a device holds any more
SCRATCH = "from scratch"
#: how often a store that failed is tried
PROBE_S = 5.0


class Record:
    """What is kept of the ward's devices; no method raises StoreError."""

    def __init__(self, store: Store, counts: Tally, now_ns: Callable[[], int]) -> None:
        self._store, self._counts, self._now_ns = store, counts, now_ns
        self._damaged, self._probed = 0, float("-inf")
        #: why the store does not work now; empty when it does
        self.trouble = store.database.trouble
        if self.trouble:
            self._counts.add("store failed")
            log.error("%s; the service goes on from memory", self.trouble)

    def tend(self, now: float) -> None:
        """Once a second: try a store that failed, and count what of it was damaged."""
        damaged = self._store.database.damaged + len(self._store.database.notes)
        if damaged > self._damaged:
            self._counts.add("damage in the store", damaged - self._damaged)
            self._damaged = damaged
        if self.trouble and now - self._probed >= PROBE_S:
            self._probed = now
            try:
                self._store.database.probe()
            except StoreError as error:
                self.trouble = str(error)
            else:
                self._works()

    def recall(self, device: Device, boot: int) -> Remembered | None:
        """What is known of this very boot, saved or not."""
        unsaved = next((c for c in reversed(device.unsaved) if c.boot == boot), None)
        if unsaved is not None:
            return Remembered(unsaved, None)
        try:
            return self._store.recall(device.name, boot, self._now_ns())
        except StoreError as error:
            self._failed(device.session, error)
            return None

    def prior(self, session: DeviceSession, info: DeviceInfo) -> Calibration | None:
        """The last calibration of the same hardware in an earlier boot."""
        try:
            return self._store.prior(info)
        except StoreError as error:
            self._failed(session, error)
            return None

    def scratch(self, session: DeviceSession, info: DeviceInfo) -> str:
        """Why no calibration of this device holds, in words for a person; empty where there is none."""
        try:
            latest = self._store.latest(info.device)
        except StoreError as error:
            self._failed(session, error)
            return ""
        return "" if latest is None else changed(latest, info, within_boot=latest.boot == info.boot)

    def started_over(self, session: DeviceSession, info: DeviceInfo, why: str) -> None:
        """For the device's history, once a boot: from here on it is calibrated from scratch."""
        request = keys.boot_id(info.boot)
        row = (info.device, SCRATCH, request, "estimator", "", why)

        def once() -> None:
            if self._store.answer(info.device, SCRATCH, request) != (True, why):
                self._store.add_audit(self._now_ns(), *row, accepted=True)

        self._keep(session, once)

    def law(self, session: DeviceSession, info: DeviceInfo) -> TemperatureLaw | None:
        """What the same hardware taught of temperature in earlier boots."""
        try:
            return learn(self._store.points(info), session.knobs.track.bias)
        except StoreError as error:
            self._failed(session, error)
            return None

    def boot(self, session: DeviceSession, info: DeviceInfo) -> None:
        """A boot whose info is known."""
        self._keep(session, lambda: self._store.add_boot(info, self._now_ns()))

    def calibration(self, device: Device, c: Calibration, now: float) -> bytes | None:
        """Keep a calibration, and the bias with it; its payload, or None where no subscriber would understand it."""
        payload = codec.encode_calibration(c)
        try:
            codec.decode_calibration(keys.build("store", "calibration", device=c.device), payload)
        except Refusal as refusal:
            if device.session.count_event("calibration unfit") == 1:
                log.error("%s: a calibration cannot be said: %s", c.device, refusal)
            return None
        if c.verdict is Verdict.ACCEPTED:
            device.unsaved = [*device.unsaved, c][-UNSAVED:]
            self.checkpoint(device, now, force=True)
        else:
            words = f"{c.verdict.name.lower()}: {c.reason}"
            row = (c.device, "calibrate", c.id, c.who, "", words)
            self._keep(device.session, lambda: self._store.add_audit(self._now_ns(), *row, accepted=False))
        return payload

    def checkpoint(self, device: Device, now: float, *, force: bool = False) -> None:
        """Every few seconds: calibrations that could not be saved yet, and the bias where it is known."""
        if now - device.checkpointed < CHECKPOINT_S and not force:
            return
        device.checkpointed = now
        self._save_calibrations(device)
        session = device.session
        state, boot = session.checkpoint(), session.boot
        if state is None or boot is None:
            return
        history = now - device.recorded >= HISTORY_S
        if history:
            device.recorded = now
            self.thin(device, now)
        doubted = session.tracker.doubted and session.calibration is not None
        row, asked = (device.name, boot, self._now_ns(), state), session.asked
        self._keep(session, lambda: self._store.save_bias(*row, history=history, doubted=doubted, asked=asked))

    def thin(self, device: Device, now: float) -> None:
        """Once a day and device, in small pieces: old points of its bias history."""
        if not device.to_thin:
            if now - device.thinned < THIN_S:
                return
            device.thinned = now
            self._keep(
                device.session, lambda: device.to_thin.extend((b, 0) for b in self._store.boots_kept(device.name))
            )
        if device.to_thin:
            boot, after_ns = device.to_thin.popleft()

            def piece() -> None:
                on_ns = self._store.thin(device.name, boot, after_ns, self._now_ns())
                if on_ns is not None:
                    device.to_thin.appendleft((boot, on_ns))

            self._keep(device.session, piece)

    def answered(self, key: keys.Key, command: Command) -> CommandReply | None:
        """What this very command was answered before, be it by an estimator that has been restarted since."""
        try:
            found = self._store.answer(key.device, key.ids["verb"], command.request_id)
        except StoreError as error:
            self._failing(error)
            return None
        return None if found is None else CommandReply(command.request_id, accepted=found[0], message=found[1])

    def audit(self, key: keys.Key, command: Command, reply: CommandReply) -> None:
        """What was asked for, and what came of it."""
        row = (key.device, key.ids["verb"], command.request_id, command.who, command.reason, reply.message)
        try:
            self._store.add_audit(self._now_ns(), *row, accepted=reply.accepted)
        except StoreError as error:
            self._failing(error)

    def _save_calibrations(self, device: Device) -> None:
        while device.unsaved:
            first = device.unsaved[0]
            if not self._keep(device.session, lambda c=first: self._store.add_calibration(c)):  # type: ignore[misc] # bound now
                if device.session.count_event("calibration not saved") == 1:
                    log.error("%s: calibration %s is not saved; it is tried again", device.name, first.id)
                return
            device.unsaved.pop(0)
            if device.session.sequence.events.as_dict().get("calibration not saved"):
                log.info("%s: calibration %s is saved", device.name, first.id)

    def _keep(self, session: DeviceSession, write: Callable[[], None]) -> bool:
        try:
            write()
        except StoreError as error:
            self._failed(session, error)
            return False
        self._works()
        return True

    def _failed(self, session: DeviceSession, error: StoreError) -> None:
        session.count_event("store failed")
        self._failing(error)

    def _failing(self, error: StoreError) -> None:
        self._counts.add("store failed")
        if not self.trouble:
            log.error("%s; the service goes on from memory (more failures are only counted)", error)
        self.trouble = str(error)

    def _works(self) -> None:
        if self.trouble:
            self.trouble = ""
            log.warning("store %s works again", self._store.path)
