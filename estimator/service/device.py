"""One device as the service has it: its session, whom it is heard from, and its publishers."""

import math
import time
from collections.abc import Callable
from dataclasses import replace

from bridge.bus.contract import Bus, Publisher
from bridge.wire import codec, keys
from bridge.wire.messages import BiasRevision, Checkpoint, Note, Status, WindowBatch
from bridge.wire.refusal import Reason
from estimator.device.admission import Admission
from estimator.device.batch_correction import Cut, Rates
from estimator.device.session import DeviceSession
from estimator.device.session_knobs import SessionKnobs
from estimator.service import output
from estimator.service.overload import OVERLOADED, UNKEPT

#: messages kept for late and returning subscribers: as many corrected ones as a bridge keeps of 50 ms, and some more
CACHES = {"corrected": 640, "status": 1, "calibration": 8, "revision": 8, "note": 8, "checkpoint": 1}
#: of a device that is another estimator's now: its rates and what they name, and a calibration that one has missed, cut off
_ASKED_FOR = "corrected", "calibration", "checkpoint"
#: a device is announced once it has sent this many samples: an id alone costs next to nothing
ANNOUNCED_AT = 5
#: what is kept of a device by whoever had it before is good for so long
FIRST_CHECKPOINT_S = 1.0
#: of who said nothing for longer it is told how old what is known is now, s
SILENT_S = 2.0
#: of a device, before some work of it: samples held, taken in, corrected and published
Counted = tuple[int, int, int, int]


class Device:
    """A session and its publishers; what fails in it is begun anew by `restart`."""

    def __init__(
        self,
        bus: Bus,
        ward: str,
        name: str,
        knobs: SessionKnobs,
        silence_s: float,
        now: float,
        epoch: int = 0,
        began: float = 0.0,
    ) -> None:
        self.name = name
        #: of our turn at it; in all that is said of it
        self.epoch = epoch
        #: which of its messages are taken, and the key under which they come
        self.admission = Admission(silence_s)
        self.key = ""
        #: when it gave its last sign of life
        self.heard = now
        #: when it is to be kept how far it is: soon, or who is killed again and again had ever more to do again, but not at first
        self.checkpoint_due, self.recorded = now + FIRST_CHECKPOINT_S, 0.0
        #: calibrations, encoded, that are said once they are kept; until then all that names them waits
        self._unsaid: dict[str, bytes] = {}
        self._held: list[bytes] = []
        self._told = ""  # the calibration that was said last
        #: how long the estimator has not kept up with all its devices; 0 when it does
        self.overloaded_s = 0
        #: whether the store does not work now
        self.unkept = False
        #: the status that was published last
        self.latest: Status | None = None
        self._delay_s: float | None = None  # of the first that was published since it was asked for
        self._bus, self._ward, self._knobs = bus, ward, knobs
        self.session = DeviceSession(name, knobs, began, self.admission.sequence)
        #: the boot number under which another power-up came, until that one is calibrated
        self.repeated: int | None = None
        #: samples that were corrected and published, or are to be: in this round, or once it is clear that there is a device
        self.told = 0
        #: corrected samples that wait until it is clear that there is a device, encoded, and how many they are
        self._waiting: list[tuple[bytes, int]] = []
        self._put: Callable[[bytes], None] = _nowhere  # publishes what is corrected
        self._gone = False
        #: samples after which it is announced: at once where another estimator has spoken of it
        self.announced_at = ANNOUNCED_AT
        self._publishers: dict[str, Publisher] = {}
        self._windowed: Publisher | None = None
        self._encoder = output.Encoder(name, epoch)

    @property
    def counted(self) -> Counted:
        """What `Isolation.failed` needs to know."""
        sequence = self.session.sequence
        return self.admission.waiting.samples, sequence.samples_in, sequence.samples_out, self.told

    @property
    def announced(self) -> bool:
        """Whether what it says is published."""
        return bool(self._publishers)

    @property
    def worthless(self) -> bool:
        """Whether nothing would be lost with it."""
        return self.session.calibration is None and self.session.prior is None

    def say_corrected(self, cut: Cut, rates: Rates) -> None:
        """Publish what was due, or keep the first few until it is clear that there is a device."""
        payload = self._encoder.encode(cut, rates)
        if not self._publishers and not self._announced():
            self._waiting.append((payload, cut.n))
            return
        if self._waiting:
            for waited, _ in self._waiting:
                self._put(waited)
            self._waiting = []
        self._put(payload)
        if self._delay_s is None:
            self._delay_s = (time.time_ns() - self.session.last_heard_ns) / 1e9

    def drop_waiting(self) -> None:
        """Another boot begins before it was clear that there is a device: what was not published is old."""
        waiting, self._waiting = sum(n for _, n in self._waiting), []
        if waiting:
            self.session.sequence.drop(Reason.OLD_BOOT, waiting)
            self.told -= waiting

    def say_windows(self, batch: WindowBatch) -> None:
        """Publish windows, if they can be said."""
        fit = output.windows(batch)
        if fit is not None and self._windowed is not None:
            self._windowed.put(codec.encode_windows(fit))

    def look_round(self) -> None:
        """Once a second: windows are made where somebody looks."""
        if self._windowed is None and self.announced:
            self._windowed = self._bus.publisher(keys.build(self._ward, "@windowed", device=self.name))
        wanted = self._windowed is not None and self._windowed.wanted
        self.session.windowed = wanted

    def say_status(self, time_ns: int) -> None:
        """Publish what is known of it now, unless that is not kept yet."""
        if not self._unsaid and (self._publishers or self._announced()):
            self.latest = self.status(time_ns)
            self._say("status", codec.encode_status(self.latest))
            self._say_known()

    def say_calibration(self, calibration: str, payload: bytes) -> None:
        """Publish an encoded calibration of this id."""
        if self._publishers or self._announced():
            self._told = calibration
            self._say("calibration", payload)

    def hold(self, calibration: str, payload: bytes) -> None:
        """Until an encoded calibration of this id is kept, rates that it corrected wait: nobody could ever look it up."""
        self._unsaid[calibration] = payload
        self._put = self._held.append

    def let_go(self, calibration: str) -> bool:
        """Publish it, and what waited for it; whether it waited itself."""
        payload = self._unsaid.pop(calibration, None)
        if payload is None:
            return False
        self.say_calibration(calibration, payload)
        if not self._unsaid:
            held, self._held = self._held, []
            if self._announced():
                for waited in held:
                    self._put(waited)
        return True

    def _say_unsaid(self) -> None:
        """What waits for the disk waits no longer."""
        for calibration in list(self._unsaid):
            self.let_go(calibration)

    def say_checkpoint(self, payload: bytes) -> None:
        """Tell the other estimators what they would need of it, encoded."""
        if self._publishers:
            self._say("checkpoint", payload)

    def _say_known(self) -> None:
        """The calibration in use, where it was said by an estimator before us: whoever joins can look it up."""
        known = self.session.calibration or self.session.prior
        if known is not None and known.id != self._told and known.id not in self._unsaid:
            self.say_calibration(known.id, codec.encode_calibration(replace(known, epoch=self.epoch)))

    def say_revision(self, revision: BiasRevision) -> None:
        """Publish what the bias of the past was, if there is anything in it that can be said."""
        fit = output.revision(revision)
        if fit is not None and (self._publishers or self._announced()):
            self._say("revision", codec.encode_revision(fit))

    def say_note(self, time_ns: int, who: str, text: str) -> None:
        """Publish what somebody wrote of it."""
        if self._publishers or self._announced():
            note = Note(self.name, self.session.boot or 0, time_ns, who, text)
            self._say("note", codec.encode_note(note))

    def status(self, time_ns: int) -> Status:
        """All of it, fit for the wire."""
        more = [(OVERLOADED, self.overloaded_s)] if self.overloaded_s else []
        more += [(UNKEPT, 1)] if self.unkept else []
        now = time.monotonic()
        silent_s = now - self.heard if now - self.heard > SILENT_S else 0.0
        said = self.session.status(
            time_ns,
            bridge=self.admission.source.owner,
            refused_bridges=self.admission.source.refused(now),
            epoch=self.epoch,
            silent_s=silent_s,
            more=more,
        )
        return output.status(said)

    def delay(self) -> float:
        """Seconds from the receipt of a sample to its publication, once since the last call; NaN when none was published."""
        delay_s, self._delay_s = self._delay_s, None
        return math.nan if delay_s is None else delay_s

    def restart(self, lost: int, uncounted: int) -> None:
        """A session without a boot: the next batch that follows what came, or a later one, begins it. See Sequence.anew."""
        sequence = self.admission.restart(lost, uncounted, self.session.last_heard_ns)
        self.session = DeviceSession(self.name, self._knobs, sequence=sequence)

    def take_over(self, known: Checkpoint) -> None:
        """Go on from a checkpoint. Raises ValueError where its state is none; nothing has changed then."""
        self.session = DeviceSession.restored(
            known.state, known.calibration, self.name, self._knobs, self.admission.sequence
        )
        self.repeated = known.boot if known.boot_repeated else None
        self.admission.go_on(self.session.sequence.next or 0, self.session.last_heard_ns)

    def leave(self) -> list[Publisher]:
        """It is another estimator's: take back what is said of it now; some may still be asked for."""
        self._say_unsaid()
        kept = [self._publishers.pop(what) for what in _ASKED_FOR if what in self._publishers]
        self.close()
        self._gone = True
        return kept

    def close(self) -> None:
        """Take its publishers back."""
        self._say_unsaid()
        for publisher in (*self._publishers.values(), *filter(None, [self._windowed])):
            publisher.close()
        self._publishers, self._windowed = {}, None

    def _announced(self) -> bool:
        if self._gone or self.session.sequence.samples_out < self.announced_at:
            return False
        put = self._publisher("corrected").put
        self._put = self._held.append if self._unsaid else put
        return True

    def _say(self, what: str, payload: bytes) -> None:
        self._publisher(what).put(payload)

    def _publisher(self, what: str) -> Publisher:
        """Declared when it is needed first: who takes over a hundred devices has other things to do at once."""
        if (publisher := self._publishers.get(what)) is None:
            key = keys.build(self._ward, what, device=self.name)
            publisher = self._publishers[what] = self._bus.publisher(key, cache=CACHES[what])
        return publisher


def _nowhere(payload: bytes) -> None:
    raise RuntimeError(f"{len(payload)} bytes of a device that is not announced")
