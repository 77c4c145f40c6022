"""Store access of the service: no sample waits for the disk, and no disk failure stops the service.

A calibration is published once it is on disk, or after half a second if the disk fails. Failed writes wait in memory
and are retried (`StoreWriter`). A checkpoint from an estimator that owned the device counts as much as the store's own
entries (`replicas`).
"""

import logging
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from bridge.reasons.codes import Sentences
from bridge.wire import codec, keys
from bridge.wire.messages import Alert, Calibration, Checkpoint, Command, CommandReply, DeviceInfo, Placement, Verdict
from bridge.wire.refusal import Refusal, Tally
from estimator.alerts.board import Change
from estimator.database import StoreError
from estimator.device.prior_knowledge import PriorKnowledge
from estimator.service.checkpoints import Checkpoints, calibrated
from estimator.service.device import Device
from estimator.service.earlier_boots import EarlierBoots
from estimator.service.store import Store
from estimator.service.store_writer import StoreWriter

log = logging.getLogger(__name__)

#: interval of checkpoints, and of points of the bias history, s
CHECKPOINT_S, HISTORY_S = 5.0, 60.0
#: audit verb for a device whose earlier calibrations no longer apply
SCRATCH = "from scratch"
#: writes that could not be stored at all are counted under this name
NOT_KEPT = "writes to the store not kept"
#: longer than a bridge keeps the messages it has sent, ns
CACHE_NS = 60_000_000_000
#: longest time that a calibration, or the answer to a command, waits for the disk, s
HELD_S = 0.5


class StoreAccess:
    """Reads and writes of the ward's store for the service; no method raises StoreError.

    clerk: the store's thread. replicas: checkpoints from other estimators. tell(device): publishes its checkpoint.
    guard(device, work): runs work of one device; a failure restarts only that device's session. now_ns: the host's
    clock, ns since the Unix epoch.
    """

    def __init__(
        self,
        store: Store,
        counts: Tally,
        now_ns: Callable[[], int],
        clerk: StoreWriter,
        replicas: Checkpoints,
        tell: Callable[[Device], None],
        guard: Callable[[Device, Callable[[], None]], object],
    ) -> None:
        self._replicas, self._tell, self._guard = replicas, tell, guard
        self._store, self._counts, self._now_ns, self._clerk = store, counts, now_ns, clerk
        #: calibrations not on disk yet, by id, in order of creation
        self._pending: dict[str, Calibration] = {}
        self.earlier = EarlierBoots(store, self._replicas, self._clerk, now_ns, self._of_device)
        #: devices whose latest bias waits to be written
        self._noting = set[str]()
        #: deadlines, monotonic s, with what is then done at the latest: publish a calibration, answer a command
        self._due: deque[tuple[float, Callable[[], None]]] = deque()
        self._known = store.calibrated_devices()

    @property
    def trouble(self) -> str:
        """Reason why the store cannot be written now; empty if it can."""
        return self._store.database.trouble

    def collect(self, now: float) -> None:
        """Call the callbacks of finished writes; release what has waited too long for a failing disk.

        These are calibrations, which are then published, and replies to commands, which are then sent. now: monotonic
        time, s.
        """
        self._clerk.collect()
        while self._due and (self._due[0][0] <= now or self.trouble):
            _, do = self._due.popleft()
            do()

    def knows(self, device: str) -> bool:
        """Return whether a calibration of a device was stored before this estimator started."""
        return device in self._known

    # ---- calibrations -----------------------------------------------------------------------------------------------

    def recall(self, device: Device, boot: int) -> PriorKnowledge | None:
        """Look up what is stored of exactly this boot: its calibration, and the bias last tracked.

        Sources are the disk, pending writes and other estimators' checkpoints. None if nothing is known, or if another
        power-up used the boot number.
        """
        if device.repeated == boot:
            return None  # all of it belongs to another power-up
        known, before = self._replicas.of(device.name), self._store.made_before(device.name, boot)
        said = calibrated(known) if known is not None and known.boot == boot else None
        repeated = known is not None and known.boot == boot and known.boot_repeated and said is None
        if said is not None and before.has(said):
            said = None  # its sender has not heard of the repeated boot number
        pending = [c for c in self._of_device(device.name) if c.boot == boot]
        if pending and (said is None or said.id != pending[-1].id):
            return PriorKnowledge(pending[-1], None)
        if said is not None:
            later = self._later(said)
            if later is None:
                self.keep(device, said)
            ours = self._store.recall(device.name, boot, self._now_ns())
            same = ours is not None and ours.calibration is not None and ours.calibration.id == (later or said).id
            return ours if same else PriorKnowledge(later or said, None)
        if repeated:
            self.repeat(device, boot)
            return None
        ours = self._store.recall(device.name, boot, self._now_ns())
        if before.seen_ns is not None and (ours is None or ours.calibration is None):
            device.repeated = boot  # restores the state before our restart; an estimator with its calibration must know
        return ours

    def stopped(self, device: str, boot: int) -> Checkpoint | None:
        """Return the checkpoint that this estimator saved at an orderly stop during this boot of a device, or None."""
        state, bridge = self._store.session(device, boot)
        if not state:
            return None
        return Checkpoint(device, boot, 0, 0, bridge, self._store.calibrated(device, boot), state=state)

    def holds(self, device: Device, known: Checkpoint) -> bool:
        """Return whether another estimator's checkpoint is consistent with the calibrations stored here.

        True: the checkpoint has no calibration of its boot, or this calibration is now being stored here. False: this
        calibration belongs to an earlier power-up, or a later one is stored here.
        """
        if (said := calibrated(known)) is None:
            return True
        if self._store.made_before(device.name, known.boot).has(said) or self._later(said) is not None:
            return False
        self.keep(device, said)
        return True

    def calibration(self, device: Device, c: Calibration, now: float) -> None:
        """Store a new calibration with the bias; publish it once it is on disk, or after 0.5 s if the disk fails.

        now: monotonic time, s. A calibration that subscribers could not decode is neither stored nor published. A
        rejected calibration is recorded in the audit.
        """
        payload = codec.encode_calibration(replace(c, epoch=device.epoch))
        try:
            codec.decode_calibration(keys.build("store", "calibration", device=c.device), payload)
        except Refusal as refusal:
            if device.session.count_event("calibration unfit") == 1:
                log.error("%s: a calibration cannot be published: %s", c.device, refusal)
            return
        if c.verdict is Verdict.ACCEPTED:
            self._replicas.forget(device.name)
            device.hold(c.id, payload)
            self._due.append((now + HELD_S, partial(self._let_go, device, c.id)))
            self.keep(device, c)
            device.recorded = float("-inf")  # forces a point of the bias history, too
            self.checkpoint(device, now, force=True)
        else:
            row = (self._now_ns(), c.device, "calibrate", c.id, c.who, c.verdict.name.lower(), c.reason)
            self._write(lambda: self._store.add_audit(*row, accepted=False))
            device.say_calibration(c.id, payload)

    def keep(self, device: Device, c: Calibration) -> None:
        """Store an accepted calibration, made here or by another estimator; then publish the rates held back for it."""
        self._pending[c.id] = c

        def saved() -> None:
            self._pending.pop(c.id, None)
            self._let_go(device, c.id)

        self._write(lambda: self._store.add_calibration(c), saved)

    def _let_go(self, device: Device, calibration: str) -> None:
        if device.let_go(calibration):
            self._guard(device, lambda: device.say_status(self._now_ns()))

    def _of_device(self, name: str) -> list[Calibration]:
        """Calibrations of a device that are not on disk yet, in order."""
        return [c for c in self._pending.values() if c.device == name]

    def _later(self, said: Calibration) -> Calibration | None:
        """Calibration made here that superseded the one a cut-off estimator still uses; by order, not by clocks."""
        made = self._store.of_boot(said.device, said.boot)
        return made[-1] if any(c.id == said.id for c in made[:-1]) else None

    # ---- boots ------------------------------------------------------------------------------------------------------

    def boot(self, info: DeviceInfo) -> None:
        """Store the start of a boot, with the device's settings from its info."""
        time_ns = self._now_ns()
        self._write(lambda: self._store.add_boot(info, time_ns))

    def started_over(self, info: DeviceInfo, why: Sentences) -> None:
        """Record in the audit, once a boot, that a device must be calibrated from scratch. why: the reasons."""
        request = keys.boot_id(info.boot)
        row = (self._now_ns(), info.device, SCRATCH, request, "estimator", "", why)

        def once() -> None:
            if self._store.answer(info.device, SCRATCH, request) != (True, why):
                self._store.add_audit(*row, accepted=True)

        self._write(once)

    def repeat(self, device: Device, boot: int, *more: Calibration) -> None:
        """Record that another power-up used this boot number before, so that the device needs a new calibration.

        more: calibrations of the earlier power-up that are still to be written. The other estimators are informed at
        once: after a crash of this one they might use the old calibration for this boot number.
        """
        device.repeated = boot
        self._replicas.forget(device.name)
        time_ns, made = self._now_ns(), [c.id for c in more if c.boot == boot]
        self._write(lambda: self._store.repeat(device.name, boot, time_ns, made))
        self._tell(device)

    def of_before(self, device: Device, calibration: Calibration) -> bool:
        """Return whether a calibration may belong to another power-up under the same boot number."""
        before = self._store.made_before(device.name, calibration.boot)
        return device.repeated == calibration.boot if before.seen_ns is None else before.has(calibration)

    # ---- where it was -----------------------------------------------------------------------------------------------

    def reached(self) -> dict[str, tuple[int, int, int, str]]:
        """Return, by device id, the last sample used for the bias, if the bias was stored within the last CACHE_NS ns.

        Bridges may replay samples of this period. Values: boot id, sequence number, host time in ns since the
        Unix epoch, and bridge.
        """
        return self._store.reached(self._now_ns() - CACHE_NS)

    def last_run(self) -> dict[str, tuple[int, int, str]]:
        """Return the devices that were in the roster when this estimator last ended.

        By device id: boot id, host time of its last stored bias in ns since the Unix epoch, and bridge (empty if
        unknown).
        """
        return self._store.last_run(round(2e9 * CHECKPOINT_S))

    def checkpoint(self, device: Device, now: float, *, force: bool = False, whole: bool = False) -> None:
        """Publish a device's checkpoint and store its bias, if known, when the next checkpoint is due.

        now: monotonic time, s. A checkpoint is due CHECKPOINT_S seconds after the last. force: do both even if none is
        due. whole: store the whole session with the bias, since no sample follows.
        """
        if now < device.checkpoint_due and not force:
            return
        device.checkpoint_due = now + CHECKPOINT_S
        self._tell(device)
        session = device.session
        state, boot = session.checkpoint(), session.boot
        if state is None or boot is None or device.ended or (device.name in self._noting and not force):
            return
        # A silent device yields nothing new: its repeated point would bias the temperature law.
        history = now - device.recorded >= HISTORY_S and device.heard > device.recorded
        if history:
            device.recorded = now
        self._noting.add(device.name)
        learnt, used = session.learnt, session.calibration
        save = partial(
            self._store.save_bias,
            device.name,
            boot,
            self._now_ns(),
            state,
            history=history,
            doubted=session.tracker.doubt.stands,
            calibration="" if used is None else used.id,
            asked=learnt.asked,
            reached=None if learnt.turned else learnt.reached,
            bridge=device.admission.owner,
            session=(session.state() or b"") if whole and not (session.prior or learnt.turned) else b"",
        )
        self._write(save, lambda: self._noting.discard(device.name), soon=force)

    # ---- who wears it -----------------------------------------------------------------------------------------------

    def placement(self, device: str) -> Placement | None:
        """Return the latest placement of a device (where and by whom it is worn), or None.

        A placement that another estimator recorded is stored here, too.
        """
        stored, said = self._store.placements(device)[-1:], self._replicas.of(device)
        if said is None or said.placement is None or (stored and stored[0].since_ns >= said.placement.since_ns):
            return stored[0] if stored else None
        self.place(device, said.placement)
        return said.placement

    def standing(self, subject: str) -> Sequence[Alert]:
        """Return the alerts of a device or an estimator that have not ended. subject: its id.

        Taken from another estimator's checkpoint if there is one, else from the store.
        """
        said = self._replicas.of(subject)
        if said is not None:
            return said.alerts
        return [alert for alert, end_ns in self._store.alerts(subject) if end_ns is None]

    def alert(self, subject: str, change: Change) -> None:
        """Store a change of an alert: raised, acknowledged or ended. subject: id of a device or an estimator."""
        time_ns = self._now_ns()
        self._write(lambda: self._store.save_alert(subject, change.alert, time_ns, cleared=change.cleared))

    def place(self, device: str, placement: Placement) -> None:
        """Store the placement of a device: where and by whom it is worn."""
        self._write(lambda: self._store.add_placement(device, placement))

    # ---- commands ---------------------------------------------------------------------------------------------------

    def answered(self, key: keys.Key, command: Command) -> CommandReply | None:
        """Return the reply to a command that was executed before, by this or another estimator; else None.

        key: bus key of the command; contains device id and verb.
        """
        for verb, reply in self._replicas.answers(key.device):
            if (verb, reply.request_id) == (key.ids["verb"], command.request_id):
                return reply
        found = self._store.answer(key.device, key.ids["verb"], command.request_id)
        return None if found is None else CommandReply(command.request_id, accepted=found[0], message=found[1])

    def erase(self, device: str) -> None:
        """Delete all stored entries of a device except its audit."""
        self._known.discard(device)
        self._write(lambda: self._store.erase(device))

    def stores(self, device: str) -> bool:
        """Return whether the store has entries of a device."""
        return device in self._store.devices()

    def audit(
        self, device: Device | None, key: keys.Key, command: Command, reply: CommandReply, kept: Callable[[], None]
    ) -> None:
        """Record a command with its reply: inform the other estimators, and write it to the audit.

        key: bus key of the command; contains device id and verb.
        device: None if it is unknown; then the other estimators are not informed. kept() is called once the entry is on
        disk, or after half a second if the disk fails.
        """
        if device is not None:
            self._replicas.answer(device.name, ((key.ids["verb"], reply),))
            self._tell(device)
        row = (key.device, key.ids["verb"], command.request_id, command.who, command.reason, reply.message)
        time_ns = self._now_ns()
        self._due.append((time.monotonic() + HELD_S, kept))
        self._write(lambda: self._store.add_audit(time_ns, *row, accepted=reply.accepted), kept)

    # ---- what fails -------------------------------------------------------------------------------------------------

    def _write(self, write: Callable[[], None], then: Callable[[], None] = lambda: None, *, soon: bool = True) -> None:
        """Queue a write; `then` is called when it is on disk, or can never be."""

        def done(error: StoreError | None) -> None:
            if error is not None and self._counts.add(NOT_KEPT) == 1:
                log.error("%s (further errors are counted, not logged)", error)
            then()

        self._clerk.do(write, done, soon=soon)
