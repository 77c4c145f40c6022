"""The store as the service uses it: what fails is counted and gone on without; calibrations wait and are tried again.

What another estimator has said of a device it had is as good as what is kept here: `replicas`; `tell` says it of ours.
`highest` is the highest epoch that is known.

A clerk writes, perhaps on a thread of its own; what came of it is heard in `collect`.

The first failure is told aloud, those after it are counted, and that it works again is told.
"""

import logging
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from bridge.wire import codec, keys
from bridge.wire.messages import Calibration, Command, CommandReply, DeviceInfo, Verdict
from bridge.wire.refusal import Refusal, Tally
from estimator.remembered import Remembered
from estimator.service.clerk import Inline, Writes
from estimator.service.device import UNSAVED, Device
from estimator.service.earlier import Earlier
from estimator.service.replicas import Replicas
from estimator.service.roster import MAX_DEVICES
from estimator.service.store import Before, Store, StoreError
from estimator.session import DeviceSession

log = logging.getLogger(__name__)

CHECKPOINT_S, HISTORY_S = 5.0, 60.0
#: how often a device's bias history is looked through for what is too old to be kept so densely
THIN_S = 86400.0
#: after so many boots of a device it is looked whether there are too many
BOOTS_LOOKED_AFTER = 32
#: what a history says where nothing known of a device holds any more
SCRATCH = "from scratch"
#: so many commands are known without the store
REPLIES = 256
#: lines of the audit that there was no room for while the store did not work are counted under
UNWRITTEN = "lines of the audit not written"
#: longer than a bridge keeps what it has sent
CACHE_NS = 60_000_000_000
#: so long nothing that names a calibration is said while the disk has not answered, s
HELD_S = 0.5
#: how often a store that failed is tried
PROBE_S = 5.0


class Record:
    """What is kept of the ward's devices; no method raises StoreError."""

    def __init__(
        self,
        store: Store,
        counts: Tally,
        now_ns: Callable[[], int],
        clerk: Writes | None = None,
        replicas: Replicas | None = None,
        tell: Callable[[Device], None] = lambda _: None,
        highest: Callable[[], int] = lambda: 0,
        guarded: Callable[[Device, Callable[[], None]], object] = lambda _, work: work(),
    ) -> None:
        self._replicas, self._tell, self._highest, self._guarded = replicas or Replicas(0), tell, highest, guarded
        self._store, self._counts, self._now_ns = store, counts, now_ns
        self._clerk = clerk or Inline()
        self._clerk.hear(self._held_up)
        self.earlier = Earlier(store, self._replicas, self._clerk, now_ns, self._failed)
        self._damaged, self._probed = 0, float("-inf")
        self._epoch = 0  # the highest that is kept
        self._boots = Counter[str]()  # noted of each device
        #: what the clerk has and has not said to be written: ids of calibrations, names of devices
        self._saving, self._noting = set[str](), set[str]()
        #: calibrations of its present boot that each device has gone by here, the latest last
        self._used: dict[str, tuple[Calibration, ...]] = {}
        #: replies to the latest commands, which may not be written yet
        self._replies: dict[tuple[str, str, str], CommandReply] = {}
        #: lines that could not be written, and of devices whose boot number came again
        self._unwritten, self._again = deque[Callable[[], None]](), dict[str, Callable[[], None]]()
        #: what is done at this time at the latest, monotonic s: to say a calibration, to answer a command
        self._due: deque[tuple[float, Callable[[], None]]] = deque()
        #: why the store does not work now; empty when it does
        self.trouble = store.database.trouble
        if self.trouble:
            self._counts.add("store failed")
            log.error("%s; the service goes on from memory", self.trouble)

    def collect(self, now: float) -> None:
        """What was written since, or failed."""
        self._clerk.collect()
        while self._due and self._due[0][0] <= now:
            _, do = self._due.popleft()
            do()

    def close(self) -> None:
        """Have written what waits."""
        self._clerk.close()

    def tend(self, now: float) -> None:
        """Once a second: try a store that failed, count what of it was damaged, and keep the highest epoch."""
        damaged = self._store.database.damaged + len(self._store.database.notes)
        if damaged > self._damaged:
            self._counts.add("damage in the store", damaged - self._damaged)
            self._damaged = damaged
        if self.trouble and now - self._probed >= PROBE_S:
            self._probed = now
            self._clerk.do(self._store.database.probe, self._probed_so)
        epoch, time_ns = self._highest(), self._now_ns()
        if epoch != self._epoch and not self.trouble:
            self._epoch = epoch
            self._clerk.do(lambda: self._store.save_epoch(epoch, time_ns), self._epoch_kept)

    def _epoch_kept(self, error: StoreError | None) -> None:
        if error is not None:
            self._epoch = 0  # it is tried again
            self._failing(error)

    def _probed_so(self, error: StoreError | None) -> None:
        if error is None:
            self._works()
        else:
            self.trouble = str(error)

    def recall(self, device: Device, boot: int) -> Remembered | None:
        """What is known of this very boot, saved or not."""
        if device.repeated == boot:
            return None  # all of it is of another power-up
        unsaved = next((c for c in reversed(device.unsaved) if c.boot == boot), None)
        said = self._replicas.recall(device.name, boot, self._now_ns())
        before = self._made_before(device, boot)
        if said is not None and said.calibration is not None and before.has(said.calibration):
            said = None  # who says so has not heard of it
        theirs = None if said is None else said.calibration
        if unsaved is not None and (theirs is None or theirs.id != unsaved.id):
            return Remembered(unsaved, None)
        if said is not None and said.calibration is not None:
            if (later := self._later(device, said.calibration)) is not None:
                return said.under(later)
            self.keep(device, said.calibration)
            return said
        if self._replicas.repeated(device.name, boot):
            self.repeat(device, boot)
            return said
        try:
            ours = self._store.recall(device.name, boot, self._now_ns())
        except StoreError as error:
            self._failed(device.session, error)
            return said
        if ours is not None and ours.calibration is not None:
            self._in_use(ours.calibration)
        elif before.seen_ns is not None:
            device.repeated = boot  # as before we were restarted: whoever has its calibration is to know
        return _joined(said, ours)

    def repeat(self, device: Device, boot: int, *more: Calibration) -> None:
        """Another power-up has this boot number, and is to be calibrated anew; more: of the one before, beside what is unsaved.

        It is said at once: we could be killed, and whoever takes it over may have what was calibrated under that number.
        """
        device.repeated = boot
        self._replicas.forget(device.name)
        self._used.pop(device.name, None)
        made = [c.id for c in (*device.unsaved, *more) if c.boot == boot]
        time_ns = self._now_ns()

        def once() -> None:
            if device.repeated == boot:  # where the store failed meanwhile, it may have been calibrated anew
                self._store.repeat(device.name, boot, time_ns, made)

        self._write_down(once, again=device.name)
        self._tell(device)

    def keep(self, device: Device, calibration: Calibration) -> None:
        """Another's calibration, which may be gone for ever with it."""
        self._in_use(calibration)
        if all(c.id != calibration.id for c in device.unsaved):
            device.unsaved = [*device.unsaved, calibration][-UNSAVED:]
        self._save_calibrations(device)

    def of_before(self, device: Device, calibration: Calibration) -> bool:
        """Whether it may be of another power-up under the same boot number."""
        before = self._made_before(device, calibration.boot)
        return device.repeated == calibration.boot if before.seen_ns is None else before.has(calibration)

    def _made_before(self, device: Device, boot: int) -> Before:
        try:
            return self._store.made_before(device.name, boot)
        except StoreError as error:
            self._failed(device.session, error)
            return Before(frozenset(), None)

    def _in_use(self, calibration: Calibration) -> None:
        """From now on its device goes by this one."""
        before = self._used.pop(calibration.device, ())
        same = (c for c in before if c.boot == calibration.boot and c.id != calibration.id)
        self._used[calibration.device] = (*same, calibration)[-UNSAVED:]
        while len(self._used) > MAX_DEVICES:
            del self._used[next(iter(self._used))]

    def _later(self, device: Device, said: Calibration) -> Calibration | None:
        """One that has taken the place of what another still goes by, who was cut off as it was made; by order, not by clocks."""
        used = self._used.get(device.name, ())
        if all(c.id != said.id for c in used):  # but before a restart, perhaps
            try:
                for c in (*self._store.of_boot(device.name, said.boot), *used):
                    self._in_use(c)
            except StoreError as error:
                self._failed(device.session, error)
        used = self._used.get(device.name, ())
        return used[-1] if any(c.id == said.id for c in used[:-1]) else None

    def reached(self) -> dict[str, tuple[int, int, int, str]]:
        """See Store.reached: of what bridges may still have of before this estimator was started."""
        try:
            return self._store.reached(self._now_ns() - CACHE_NS)
        except StoreError as error:
            self._failing(error)
            return {}

    def epoch(self) -> int:
        """The highest epoch that was known before this estimator was started."""
        try:
            self._epoch = self._store.epoch()
        except StoreError as error:
            self._failing(error)
        return self._epoch

    def started_over(self, session: DeviceSession, info: DeviceInfo, why: str) -> None:
        """For the device's history, once a boot: from here on it is calibrated from scratch."""
        request = keys.boot_id(info.boot)
        row = (info.device, SCRATCH, request, "estimator", "", why)

        def once() -> None:
            if self._store.answer(info.device, SCRATCH, request) != (True, why):
                self._store.add_audit(self._now_ns(), *row, accepted=True)

        self._keep(session, once)

    def boot(self, session: DeviceSession, info: DeviceInfo) -> None:
        """A boot whose info is known."""
        time_ns, device = self._now_ns(), info.device
        self._keep(session, lambda: self._store.add_boot(info, time_ns))
        self._boots[device] += 1
        if self._boots[device] % BOOTS_LOOKED_AFTER == 0:
            self._keep(session, lambda: self._thinned(device, time_ns))

    def _thinned(self, device: str, now_ns: int) -> None:
        self._store.thin_boots(device, now_ns)

    def calibration(self, device: Device, c: Calibration, now: float) -> None:
        """Keep a calibration, and the bias with it, and then say it: who hears of one can rely on it, unless the disk fails.

        One that no subscriber would understand is neither kept nor said.
        """
        payload = codec.encode_calibration(replace(c, epoch=device.epoch))
        try:
            codec.decode_calibration(keys.build("store", "calibration", device=c.device), payload)
        except Refusal as refusal:
            if device.session.count_event("calibration unfit") == 1:
                log.error("%s: a calibration cannot be said: %s", c.device, refusal)
            return
        if c.verdict is Verdict.ACCEPTED:
            self._replicas.forget(device.name)
            self._in_use(c)
            device.unsaved = [*device.unsaved, c][-UNSAVED:]
            device.hold(c.id, payload)
            self._due.append((now + HELD_S, partial(self._let_go, device, c.id)))
            device.recorded = float("-inf")  # a point of the history, too
            self.checkpoint(device, now, force=True)
        else:
            words = f"{c.verdict.name.lower()}: {c.reason}"
            row = (c.device, "calibrate", c.id, c.who, "", words)
            time_ns = self._now_ns()
            self._keep(device.session, lambda: self._store.add_audit(time_ns, *row, accepted=False))
            device.say_calibration(c.id, payload)

    def checkpoint(self, device: Device, now: float, *, force: bool = False) -> None:
        """Every few seconds: calibrations that could not be saved yet, and the bias where it is known."""
        if now < device.checkpoint_due and not force:
            return
        device.checkpoint_due = now + CHECKPOINT_S
        self._tell(device)
        self._save_calibrations(device)
        session = device.session
        state, boot = session.checkpoint(), session.boot
        if state is None or boot is None:
            return
        # Of one that is silent nothing new is known: a law would be taught the same point again and again.
        history = now - device.recorded >= HISTORY_S and device.heard > device.recorded
        if history:
            device.recorded = now
            self.thin(device, now)
        if device.name in self._noting and not force:
            return
        self._noting.add(device.name)
        doubted, used = session.tracker.doubt.stands, session.calibration
        calibration = "" if used is None else used.id
        row, learnt, bridge = (device.name, boot, self._now_ns(), state), session.learnt, device.admission.source.owner
        asked, reached = learnt.asked, None if learnt.turned else learnt.reached
        self._keep(
            session,
            lambda: self._store.save_bias(
                *row,
                history=history,
                doubted=doubted,
                calibration=calibration,
                asked=asked,
                reached=reached,
                bridge=bridge,
            ),
            lambda _: self._noting.discard(device.name),
            soon=force,
        )

    def thin(self, device: Device, now: float) -> None:
        """Once a day and device, in small pieces: old points of its bias history."""
        if not device.to_thin:
            if now - device.thinned < THIN_S:
                return
            device.thinned = now
            self._look_for_old(device)
        if not device.to_thin:
            return  # none, or the clerk still looks
        boot, after_ns = device.to_thin.popleft()
        on_ns: list[int | None] = []
        self._keep(
            device.session,
            lambda: on_ns.append(self._store.thin(device.name, boot, after_ns, self._now_ns())),
            lambda _: device.to_thin.extendleft((boot, ns) for ns in on_ns[-1:] if ns is not None),
        )

    def _look_for_old(self, device: Device) -> None:
        boots: list[list[str]] = []
        self._keep(
            device.session,
            lambda: boots.append(self._store.boots_kept(device.name)),
            lambda _: device.to_thin.extend((boot, 0) for kept in boots[-1:] for boot in kept),
        )

    def answered(self, key: keys.Key, command: Command) -> CommandReply | None:
        """What this very command was answered before, be it by an estimator that has been restarted since."""
        if (reply := self._replies.get((key.device, key.ids["verb"], command.request_id))) is not None:
            return reply
        for verb, reply in self._replicas.answers(key.device):
            if (verb, reply.request_id) == (key.ids["verb"], command.request_id):
                return reply
        try:
            found = self._store.answer(key.device, key.ids["verb"], command.request_id)
        except StoreError as error:
            self._failing(error)
            return None
        return None if found is None else CommandReply(command.request_id, accepted=found[0], message=found[1])

    def audit(
        self, device: Device, key: keys.Key, command: Command, reply: CommandReply, kept: Callable[[], None]
    ) -> None:
        """What was asked for, and what came of it: said to the other estimators, and written, before it is answered.

        kept is called when it is, at once where it cannot be, and at the latest when one who asks would wait no longer.
        """
        self._replicas.answer(device.name, ((key.ids["verb"], reply),))
        self._tell(device)
        self._replies[key.device, key.ids["verb"], command.request_id] = reply
        while len(self._replies) > REPLIES:
            del self._replies[next(iter(self._replies))]
        row = (key.device, key.ids["verb"], command.request_id, command.who, command.reason, reply.message)
        time_ns = self._now_ns()
        self._due.append((time.monotonic() + HELD_S, kept))
        self._write_down(lambda: self._store.add_audit(time_ns, *row, accepted=reply.accepted), kept)

    def _write_down(
        self, line: Callable[[], None], then: Callable[[], None] = lambda: None, *, again: str = ""
    ) -> None:
        """A line of the audit; where it cannot be written now, it is when the store works again.

        again: the device of which it says that its boot number came again; of others only so many are kept.
        """

        def done(error: StoreError | None) -> None:
            if error is not None:
                self._failing(error)
                if again:
                    self._again[again] = line
                else:
                    self._unwritten.append(line)
                if len(self._unwritten) > REPLIES:
                    self._unwritten.popleft()
                    self._counts.add(UNWRITTEN)
            then()

        self._clerk.do(line, done)

    def _save_calibrations(self, device: Device) -> None:
        """All of them in their order, though some are on their way: which was kept last is which holds after a restart."""
        waiting = tuple(device.unsaved)
        if all(c.id in self._saving for c in waiting):
            return
        self._saving.update(c.id for c in waiting)

        def write() -> None:
            for c in waiting:
                self._store.add_calibration(c)

        def done(error: StoreError | None) -> None:
            for c in waiting:
                self._saved(device, c, error)

        self._keep(device.session, write, done)

    def _saved(self, device: Device, c: Calibration, error: StoreError | None) -> None:
        self._saving.discard(c.id)
        if error is not None:
            waits = any(c is other for other in device.unsaved)
            if waits and device.session.count_event("calibration not saved") == 1:
                log.error("%s: calibration %s is not saved; it is tried again", device.name, c.id)
        elif any(c is other for other in device.unsaved):
            device.unsaved = [other for other in device.unsaved if other is not c]
            if device.session.sequence.events.as_dict().get("calibration not saved"):
                log.info("%s: calibration %s is saved", device.name, c.id)
        self._let_go(device, c.id)

    def _let_go(self, device: Device, calibration: str) -> None:
        if device.let_go(calibration):
            self._guarded(device, lambda: device.say_status(self._now_ns()))

    def _keep(
        self,
        session: DeviceSession,
        write: Callable[[], None],
        then: Callable[[StoreError | None], None] = lambda _: None,
        *,
        soon: bool = True,
    ) -> None:
        def done(error: StoreError | None) -> None:
            if error is None:
                self._works()
            else:
                self._failed(session, error)
            then(error)

        self._clerk.do(write, done, soon=soon)

    def _failed(self, session: DeviceSession, error: StoreError) -> None:
        session.count_event("store failed")
        self._failing(error)

    def _held_up(self, error: StoreError | None) -> None:
        """What is to be written waits for who has the file."""
        if error is not None:
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
            again, self._again = self._again, {}
            for device, line in again.items():
                self._write_down(line, again=device)
            for _ in range(len(self._unwritten)):
                self._write_down(self._unwritten.popleft())


def _joined(said: Remembered | None, ours: Remembered | None) -> Remembered | None:
    """What another has said of a boot that it had no calibration of, and what is kept here."""
    if said is None:
        return ours
    if ours is None or ours.calibration is None:
        return said
    # Whoever had the device after us has not heard of our calibration.
    if said.bias is None and not said.doubted:
        return replace(ours, asked=said.asked or ours.asked)
    return said.under(ours.calibration)
