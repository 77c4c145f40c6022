"""One device from its first sample on: readings in; corrected rates, calibrations and a status out.

A pure core: no clock, no bus, no store. Time is the device's own, in the batches; what was remembered of earlier boots
is handed in. What a half second of device time teaches (`block`) is used from the end of the next one on: any batching of the
same samples gives the same corrected rates, and whoever runs it may learn meanwhile, when there is time.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from bridge.wire.messages import (
    BiasRevision,
    Calibration,
    CorrectedBatch,
    DeviceInfo,
    Quality,
    SampleBatch,
    State,
    Status,
    Verdict,
)
from bridge.wire.refusal import Reason
from estimator.batch.capture import Floats, Rest, Samples
from estimator.batch.names import DEFAULT
from estimator.batch.result import Result
from estimator.batch.session import CalibrationSession, Finished, Ignored, Progress, RestFound, TurnFound
from estimator.block import BLOCK_S, Block, Part, joined, sample_time_ns, temperature_at
from estimator.correction import Correction, Cut, believed, choose
from estimator.finite import runs
from estimator.gyro import AXES, PriorKnobs, reading_std
from estimator.lifecycle import Event, Life
from estimator.past import Past
from estimator.sequence import Sequence
from estimator.stillness import Stillness, StillnessKnobs, Window
from estimator.track.bias_filter import BIAS, BiasState, Receipt, start
from estimator.track.temperature import TemperatureLaw
from estimator.track.tracker import RestBias, Tracker, TrackKnobs
from estimator.windowed import Second, Windowed

#: counted under this: turns that did not come along when another estimator took the device over
TURNS_LOST = "turns lost with an estimator"
#: device time that is taken to have passed when a bridge, started anew, has lost count of the turns of the device's clock
CLOCK_LOST_S = 1.0
#: samples this much older than the last checkpoint are the bus's cache; older ones mean that the clock lost count
CACHE_S = 60.0
#: after a silence this long the bias is less certain from the first sample on, not only once a second was judged
SILENCE_S = 5.0


@dataclass(frozen=True, slots=True)
class SessionKnobs:
    """How a device is treated. Seconds of device time."""

    method: str = DEFAULT
    #: after power-up, before anything is believed
    warming_s: float = 1.0
    prior: PriorKnobs = field(default_factory=PriorKnobs)
    stillness: StillnessKnobs = field(default_factory=StillnessKnobs)
    track: TrackKnobs = field(default_factory=TrackKnobs)


@dataclass(frozen=True, slots=True)
class Remembered:
    """What the store knows of a device that boots: its last calibration, and, of this very boot, the bias since."""

    calibration: Calibration | None
    bias: BiasState | None
    #: host seconds since the bias was kept, and whether it was in doubt then
    age_s: float = 0.0
    doubted: bool = False
    #: who had asked for a recalibration that was under way then, and why
    asked: tuple[str, str] | None = None
    #: axes whose turns were taken then, by another estimator: they are to be taken again
    turned: tuple[int, ...] = ()


@dataclass(slots=True)
class Outcome:
    """What a batch led to. `said` are things to log, most important last."""

    corrected: list[CorrectedBatch] = field(default_factory=list)
    calibration: Calibration | None = None
    revision: BiasRevision | None = None
    seconds: list[Second] = field(default_factory=list)
    changed: bool = False
    said: list[str] = field(default_factory=list)

    @property
    def worded(self) -> bool:
        """Whether anything but samples is to be published of it."""
        return self.changed or self.calibration is not None or self.revision is not None


class DeviceSession:
    """The life of one device across its boots; `began`, device s, if it is known when the first of them begins."""

    def __init__(self, device: str, knobs: SessionKnobs | None = None, began: float = 0.0) -> None:
        self.device = device
        self.knobs = knobs or SessionKnobs()
        self.life = Life()
        self.sequence = Sequence()
        self.info: DeviceInfo | None = None
        self.reason = self._reason_before = "never seen"
        self.calibration: Calibration | None = None  # of this boot
        self.prior: Calibration | None = None  # of an earlier boot, under the same restore key
        self.last_heard_ns = 0
        #: keeps what windows are made of, where somebody looks at them
        self.windowed: Windowed | None = None
        self._begin(began)
        self._unused = True  # since it was begun

    # ---- boots ----------------------------------------------------------------------------------------------------

    def begin_boot(
        self,
        boot: int,
        device_time: float,
        remembered: Remembered | None,
        law: TemperatureLaw | None = None,
        temperature_c: float | None = None,
    ) -> Outcome:
        """The device has started anew (or we have): forget this boot's calibration, then use what is remembered.

        law: what earlier boots taught of temperature. temperature_c: the device's now.
        """
        outcome = self.learn()  # what came of the one before
        first, again = self.boot is None, boot == self.boot and self.sequence.next is None
        self.sequence.begin(boot)
        if not self._unused or device_time != self._began or law is not None:
            self._begin(device_time, law)
        self._unused = False
        self.life.on(Event.BOOTED)
        if not again:  # nothing was taken of it yet
            self.reason = (
                "warming up" if first else "the device was restarted: hold it still, then turn it about x, y and z"
            )
        outcome.changed = True
        outcome.said.append(f"boot {boot:016x}" + ("" if first else ", recalibration needed"))
        calibration = None if remembered is None else remembered.calibration
        if remembered is not None and calibration is not None and calibration.boot == boot:
            self._restore(remembered, calibration, temperature_c)
            outcome.said.append(f"calibration {self._calibration_id} of this boot restored")
        elif calibration is not None:
            self.believe(calibration)
        if remembered is not None and remembered.bias is not None and self.calibration is None:
            kept = self._resumed(remembered, remembered.bias)
            self.tracker.restored(self._belief.model, kept, self._now, temperature_c)
            self._apply()
            outcome.said.append("bias of this boot restored")
        if remembered is not None and remembered.turned:
            self._lost_turns(remembered.turned, outcome)
        return outcome

    def _begin(self, device_time: float, law: TemperatureLaw | None = None) -> None:
        self.calibration, self.prior, self._law = None, None, law
        #: why nothing known of earlier holds, said until it is calibrated
        self.scratch = ""
        self._stillness = Stillness(self.knobs.stillness)
        self._belief = believed(None, None, self.knobs.prior)
        self.tracker = Tracker(self.knobs.track, device_time, self._belief.model, self._belief.bias_std, law)
        self._capture: CalibrationSession | None = CalibrationSession(self.knobs.method)
        self._block, self._block_number = Block(), int(device_time // BLOCK_S)
        #: device time of the last window that was judged, and of the last sample
        self._now = self._latest = self._began = device_time
        self._now_ns = 0  # host time of the last window
        self._clock_shift = 0.0
        self._who = self._why = ""
        self._first_time: float | None = None
        self._silent_until = -np.inf  # device time of the first sample after the latest silence
        self._done_axes: tuple[int, ...] = ()
        self._past = Past()
        #: what is applied now, and from the end of this block on
        self._applied = self._ready = self._correction()
        #: the last whole block, while nothing is learnt from it yet, and what was applied to it
        self._lesson, self._lesson_applied = list[Part](), self._applied

    def _lost_turns(self, axes: tuple[int, ...], outcome: Outcome) -> None:
        if self._capture is None:
            return
        names = ", ".join(AXES[axis] for axis in axes)
        self.scratch = (
            f"the turns about {names} were taken by an estimator that does not have it now: turn it about all three"
        )
        self.sequence.events.add(TURNS_LOST, len(axes))
        outcome.said.append(self.scratch)

    def start_over(self, why: str) -> Outcome:
        """It is not what it was: nothing known of it holds any more. Its samples go on."""
        self.life.on(Event.CHANGED)
        shift, first_time = self._clock_shift, self._first_time
        self._begin(self._latest)
        self._clock_shift, self._first_time = shift, first_time
        self.scratch = why
        self.reason = self._reason_before = "hold the device still for 3 seconds"
        return Outcome(changed=True, said=[why])

    def _restore(self, remembered: Remembered, calibration: Calibration, temperature_c: float | None) -> None:
        self.calibration = calibration
        self._belief = believed(calibration, None, self.knobs.prior)
        kept = remembered.bias
        kept = self._wider(self._bias_of(calibration)) if kept is None else self._resumed(remembered, kept)
        self.tracker.restored(self._belief.model, kept, self._now, temperature_c)
        self._capture = None
        self.life.on(Event.RESTORED)
        self.reason = "calibrated; the calibration of this boot goes on"
        if remembered.doubted:
            self.tracker.doubted = True
            self.life.on(Event.DOUBTED)
            self.reason = "calibrated; the bias was in doubt when the estimator was restarted, a rest has to confirm it"
        if remembered.asked is not None:
            self.recalibrate(*remembered.asked)
        self._apply()

    def _resumed(self, remembered: Remembered, kept: BiasState) -> BiasState:
        """The bias as it was kept; wider where it is not known how long ago it was so: a rest has to confirm it."""
        passed = self._now - kept.time
        unknown = passed < -CACHE_S or remembered.age_s - passed > CACHE_S
        return self._wider(replace(kept, time=self._now)) if unknown else kept

    def _wider(self, state: BiasState) -> BiasState:
        wider = state.P.copy()
        wider[BIAS, BIAS] += self.knobs.track.bias_std**2 * np.eye(3)
        return replace(state, P=wider)

    def believe(self, calibration: Calibration) -> None:
        """Use the scale factors of an earlier boot until this one is calibrated."""
        if self.calibration is None:
            self.prior = calibration
            self._belief = believed(None, calibration, self.knobs.prior)
            if not self.tracker.sure:
                self.tracker.supposed(self._belief.model, self._belief.bias_std, self._now)
            self._apply()

    def adopt(self, calibration: Calibration) -> None:
        """A calibration of this very boot, by who had the device meanwhile; it ends one that is under way here."""
        self._restore(Remembered(calibration, None), calibration, self.tracker.temperature_c)
        self.scratch, self._done_axes = "", ()

    def expect(self, law: TemperatureLaw) -> None:
        """Use what earlier boots taught of temperature, where it was not known when this one began."""
        self._law = law
        if self.calibration is None:
            self.tracker.expect(law)
        else:
            self.tracker.follow(law)

    # ---- samples --------------------------------------------------------------------------------------------------

    @property
    def boot(self) -> int | None:
        """The boot whose samples are taken."""
        return self.sequence.boot

    @property
    def near(self) -> bool:
        """Whether what comes next may end a calibration, which takes as long as hundreds of batches."""
        return self._capture is not None and self._capture.near

    @property
    def applied(self) -> Correction:
        """What is applied to the samples that come next."""
        return self._applied

    def begins_earlier(self, batch: SampleBatch) -> bool:
        """Whether a batch is of the time before this boot was taken to begin, and nothing of it was taken yet."""
        return self.sequence.next is None and float(batch.device_time[0]) < self._began

    def plain(self, boot: int, sequence: int, first_s: float) -> bool:
        """Whether a batch, all of it finite and from first_s of the device's clock on, only goes on where the stream is."""
        return (
            boot == self.sequence.boot
            and sequence == self.sequence.next
            and self._first_time is not None
            and first_s + self._clock_shift > self._latest
            and not self.life.away
        )

    def ends_block(self, last_s: float) -> bool:
        """Whether a sample at last_s of the device's clock is beyond the block that waits."""
        return (last_s + self._clock_shift) // BLOCK_S != self._block_number

    def keep(self, batch: SampleBatch, time: Floats) -> None:
        """Take a plain batch that ends no block, taken at time (n,) by the device's clock.

        It is to be corrected by `applied`, which is all that `handle` would do.
        """
        self._went_on(batch)
        if self._clock_shift:
            time = time + self._clock_shift
        self._block.add(time, batch, 0, len(time))
        self._latest = float(time[-1])

    def end_block(self, batch: SampleBatch) -> tuple[Outcome, list[Cut]]:
        """Take a plain batch that ends a block, as `take` would; what of it is to be corrected by what, besides the outcome."""
        outcome = Outcome()
        self._went_on(batch)
        return outcome, self._take(batch, 0, len(batch.ticks), 0.0, outcome)

    def _went_on(self, batch: SampleBatch) -> None:
        self.sequence.went_on(len(batch.ticks))
        self.last_heard_ns = batch.receive_time_ns

    def handle(self, batch: SampleBatch) -> Outcome:
        """Take a batch and learn from it."""
        outcome = self.take(batch)
        self._learn(outcome)
        return outcome

    @property
    def to_learn(self) -> bool:
        """Whether there is a whole block that nothing was learnt from yet."""
        return bool(self._lesson)

    def learn(self) -> Outcome:
        """What the last whole block teaches; by itself at the end of the next one, from which on it is applied."""
        outcome = Outcome()
        self._learn(outcome)
        return outcome

    def take(self, batch: SampleBatch) -> Outcome:
        """Take a batch of the current boot (see Sequence.is_new_boot); samples late, repeated or not finite are counted."""
        outcome = Outcome()
        first = self.sequence.fresh(batch)
        if first == len(batch):
            return outcome
        away_s = max(0.0, (batch.receive_time_ns - self.last_heard_ns) / 1e9 / batch.clock_rate)
        self.last_heard_ns = batch.receive_time_ns
        if self.life.on(Event.HEARD):
            self.reason = self._reason_before
            self._apply()
            outcome.changed = True
            outcome.said.append("heard again")
        finite = runs(batch, first)
        self.sequence.drop(Reason.NON_FINITE, len(batch) - first - sum(end - begin for begin, end in finite))
        for begin, end in finite:
            cuts = self._take(batch, begin, end, away_s, outcome)
            outcome.corrected += [cut.correction.apply(batch, cut.first, cut.last) for cut in cuts]
        return outcome

    def _take(self, batch: SampleBatch, first: int, last: int, away_s: float, outcome: Outcome) -> list[Cut]:
        time = self._going_on(batch.device_time[first:last], away_s)
        if self._first_time is None:
            self._first_time = float(time[0])
        blocks = time // BLOCK_S
        edges = [] if blocks[0] == self._block_number else [0]
        edges += ((blocks[1:] != blocks[:-1]).nonzero()[0] + 1).tolist()
        self._block_number = int(blocks[-1])
        cuts, start, held = list[Cut](), 0, 0
        for edge in edges:
            self._hold(time, batch, first, held, edge)
            held, before = edge, self._applied
            now, latest = float(time[edge]), float(time[edge - 1]) if edge else self._latest
            self._end_block(outcome, now if now - latest > SILENCE_S else None)
            if edge > start and not self._applied.same(before):
                cuts.append(Cut(before, first + start, first + edge))
                start = edge
        self._hold(time, batch, first, held, len(time))
        self._latest = float(time[-1])
        return [*cuts, Cut(self._applied, first + start, last)]

    def _hold(self, time: Floats, batch: SampleBatch, first: int, begin: int, end: int) -> None:
        if end > begin:
            self._block.add(time[begin:end], batch, first + begin, first + end)

    def _end_block(self, outcome: Outcome, resumed: float | None = None) -> None:
        """From here on all is applied that was learnt from the blocks before the one that ends, which is the next lesson.

        resumed: device time of the next sample, where a silence is before it.
        """
        self._learn(outcome)
        if resumed is not None:
            self._silent_until = resumed
            self._ready = self._correction()
        self._lesson, self._lesson_applied = self._block.take(), self._applied
        self._applied = self._ready

    def _learn(self, outcome: Outcome) -> None:
        parts, self._lesson = self._lesson, []
        before = self.tracker.time, self._belief
        for run in joined(parts):
            if self.windowed is not None:
                outcome.seconds += self.windowed.add(run, self._lesson_applied)
            for window in self._stillness.feed(run.time, run.gyro, run.accel, run.unfit):
                self._now = window.end_time
                batch, index = self._block.where(window.end - 1)
                self._now_ns = sample_time_ns(batch, index)
                if (celsius := temperature_at(batch, index)) is not None:
                    self.tracker.temperature(self._now, celsius)
                tracked = self.tracker.time
                self._window(window, outcome)
                self._past.note(self._now, batch.sequence + index, self._now_ns, self.tracker.time)
                if self.tracker.time != tracked and (improved := self.tracker.improved()) is not None:
                    outcome.revision = self._past.revision(
                        batch, self._belief.calibration, self._belief.model.matrix, *improved
                    )
        if (self.tracker.time, self._belief) != before:  # where nothing is learnt batches stay whole
            self._ready = self._correction()

    def end(self) -> Outcome:
        """The stream is over: what its last blocks teach, without any more samples."""
        outcome = Outcome()
        self._end_block(outcome)
        self._learn(outcome)
        return outcome

    def _going_on(self, time: Floats, away_s: float) -> Floats:
        shifted = time + self._clock_shift
        if self._first_time is not None and shifted[0] <= self._latest:
            self.sequence.events.add("device clock went back")
            # At least as long has passed as the host has seen.
            self._clock_shift += self._latest + max(CLOCK_LOST_S, away_s) - float(shifted[0])
            return time + self._clock_shift
        return shifted

    # ---- windows: evidence and calibration ------------------------------------------------------------------------

    def _window(self, window: Window, outcome: Outcome) -> None:
        if self._capture is not None:
            self._capture.add(Samples.of([window]))
        if self.life.state is State.WARMING:
            if window.end_time - self._began >= self.knobs.warming_s or self._began > self.knobs.warming_s:
                self._happens(Event.WARM, "hold the device still for 3 seconds", outcome)
            self.tracker.skip(window)
            return
        tracked = self.tracker.time
        receipts = self.tracker.window(window, self._stillness.noise_std)
        if self.tracker.time != tracked:
            self._second(receipts, outcome)
        if self._capture is not None:
            for progress in self._capture.window(window):
                self._progress(progress, outcome)

    def _second(self, receipts: list[Receipt], outcome: Outcome) -> None:
        """What the tracker makes of a second, or of some."""
        for receipt in receipts:
            if not receipt.accepted:
                self.sequence.events.add(f"{receipt.kind}: {receipt.reason}")
            elif self.tracker.trust():
                self._happens(Event.CONFIRMED, "calibrated; the bias was confirmed at rest", outcome)
        if self.tracker.law_refuted and self._law is not None:
            self._law = None
            self.sequence.events.add("temperature law disagrees")
            outcome.said.append("temperature moves its bias otherwise than in earlier boots: learnt anew")
        if (reason := self.tracker.doubt(self._now)) is not None:
            self._happens(Event.DOUBTED, reason, outcome)

    def _progress(self, progress: Progress, outcome: Outcome) -> None:
        match progress:
            case RestFound():
                self._happens(Event.RESTED, f"still: now turn it once about {self._missing()}", outcome)
            case TurnFound(turn):
                before, self._done_axes = self._done_axes, self._capture.done() if self._capture is not None else ()
                gone = ", ".join(AXES[axis] for axis in before if axis not in (*self._done_axes, turn.axis))
                needed = f"; the turn about {gone} is too old, or the bias has moved since" if gone else ""
                needed += f"; still needed: {self._missing()}" if len(self._done_axes) < 3 else ""
                self._happens(Event.TURNED, f"turn about {AXES[turn.axis]} taken{needed}", outcome)
            case Ignored(no_turn):
                self.sequence.events.add("movement ignored")
                self.reason = f"{no_turn.reason}; still needed: {self._missing()}"
                outcome.changed = True
                outcome.said.append(self.reason)
            case Finished(result, rest):
                self._finish(result, rest, outcome)

    def _finish(self, result: Result, rest: Rest, outcome: Outcome) -> None:
        outcome.calibration = self._as_message(result)
        if result.verdict is not Verdict.ACCEPTED:
            self._done_axes = tuple(axis for axis in self._done_axes if axis not in result.repeat)
            self._happens(Event.NOT_CALIBRATED, result.reason, outcome)
            return
        self.calibration, self.prior, self._capture, self.scratch = outcome.calibration, None, None, ""
        self._belief = believed(self.calibration, None, self.knobs.prior)
        self.tracker.calibrated(self._belief.model, result.covariance[:3, :3], result.bias_time, _bias_in(rest))
        self._happens(Event.CALIBRATED, f"calibrated: {result.reason}", outcome)

    def _happens(self, event: Event, reason: str, outcome: Outcome) -> None:
        before = self.life.state
        if self.life.on(event):
            self.reason = reason
            outcome.changed = True
            outcome.said.append(f"{before.name} -> {self.life.state.name}: {reason}")

    # ---- people and time ------------------------------------------------------------------------------------------

    def recalibrate(self, who: str, reason: str) -> str | None:
        """Ask for three new turns; the present calibration stays in use until they are taken. None, or why not."""
        if not self.life.on(Event.RECALIBRATE):
            so = (
                "it will be calibrated anyway"
                if self.life.state is State.WARMING
                else "nothing to do until it is heard"
            )
            return f"{self.device} is {self.life.state.name.lower()}: {so}"
        self._who, self._why = who, reason
        self._capture = CalibrationSession(self.knobs.method)
        self._done_axes = ()
        self.reason = f"recalibration asked for by {who}{': ' + reason if reason else ''}; hold it still for 3 seconds"
        return None

    def cancel(self, who: str) -> str | None:
        """Stop a calibration under way; the old one stays. None, or why not."""
        event = Event.CANCEL_TO_START if self.calibration is None else Event.CANCEL_TO_TRACKING
        if not self.life.on(event):
            return f"{self.device} is {self.life.state.name.lower()}: no calibration is under way"
        if self.tracker.doubted:
            self.life.on(Event.DOUBTED)
        self._done_axes, self._who = (), ""
        self.scratch = "" if self.calibration is not None else self.scratch
        self._capture = None if self.calibration is not None else CalibrationSession(self.knobs.method)
        goes_on = (
            "the old one stays"
            if self.calibration is not None
            else "hold the device still for 3 seconds to begin again"
        )
        said = f"calibration cancelled by {who}; {goes_on}"
        if self.life.away:
            self._reason_before = said
        else:
            self.reason = said
        return None

    def silence(self, reason: str, event: Event = Event.SILENT) -> bool:
        """No samples come any more, or may come (UNREACHABLE), for this reason as it is now; True when that is news."""
        was_away = self.life.away
        if not self.life.on(event):
            if self.life.state is State.LOST and event is Event.SILENT:
                self.reason = reason
            return False
        if not was_away:
            self._reason_before = self.reason
        self.reason = reason
        self._apply()
        return True

    # ---- what is known --------------------------------------------------------------------------------------------

    def status(self, time_ns: int) -> Status:
        """All of it, for the bus."""
        known = self._ready
        done = self.turned
        share = (0.1 * self.tracker.sure + 0.3 * len(done)) if self._capture is not None else 1.0
        return Status(
            device=self.device,
            boot=self.boot or 0,
            time_ns=time_ns,
            state=self.life.state,
            quality=known.quality,
            reason=f"{self.reason} ({self.scratch})" if self.scratch else self.reason,
            progress=min(share, 1.0),
            axes_done=done,
            bias=tuple(map(float, known.model.bias)),
            bias_std=tuple(map(float, known.bias_std)),
            scale=tuple(map(float, np.diag(known.model.matrix))),
            calibration=known.calibration,
            calibrated_time_ns=self.calibration.time_ns if self.calibration else 0,
            evidence_age_s=self.tracker.evidence_age(self._now),
            temperature_c=self.tracker.temperature_c,
            rate_hz=self._rate(),
            samples_in=self.sequence.samples_in,
            samples_out=self.sequence.samples_out,
            dropped=self.sequence.dropped.as_dict(),
            events={**self.sequence.events.as_dict(), **self.tracker.events},
        )

    def count_event(self, name: str) -> int:
        """Count something that happened to this device outside the core."""
        return self.sequence.events.add(name)

    def checkpoint(self) -> BiasState | None:
        """The bias as it would be restored; of a calibrated boot, or one that is sure of it, of which anything came."""
        known = self.sequence.next is not None and (self.calibration is not None or self.tracker.sure)
        return self.tracker.worth_keeping if known else None

    @property
    def goes_on(self) -> str:
        """The reason as it is, or will be when the device is heard again."""
        return self._reason_before if self.life.away else self.reason

    @property
    def asked(self) -> tuple[str, str] | None:
        """Who asked for the recalibration that is under way, and why; None while none is."""
        return (self._who, self._why) if self._who and self._capture is not None else None

    @property
    def turned(self) -> tuple[int, ...]:
        """Axes whose turns are taken, of a calibration under way."""
        return self._done_axes if self._capture is not None else ()

    @property
    def _calibration_id(self) -> str:
        return self.calibration.id if self.calibration else ""

    def _apply(self) -> None:
        """Use all that is known at once: it does not come from samples."""
        self._applied = self._ready = self._correction()

    def _correction(self) -> Correction:
        noise_std = reading_std(self._stillness.noise_std) if self._stillness.noise_known else None
        track = self.tracker
        std = track.std_at(self._silent_until)
        sure = track.sure and bool((std < self.knobs.track.bias_std).all())
        best = choose(self._belief, track.bias, std, noise_std, sure=sure)
        doubtful = self.life.away or track.doubted or not sure
        return replace(best, quality=Quality.DEGRADED) if best.quality is Quality.GOOD and doubtful else best

    def _as_message(self, result: Result) -> Calibration:
        info = self.info
        boot = self.boot or 0
        # The wire takes no infinity: what was not estimated is not named.
        known = bool(np.all(np.isfinite(result.covariance)))
        return Calibration(
            device=self.device,
            boot=boot,
            id=f"{self.device}-{boot:016x}-{self._now_ns // 1_000_000:x}",
            time_ns=self._now_ns,
            method=result.method,
            verdict=result.verdict,
            reason=result.reason,
            matrix=result.matrix,
            bias=result.bias,
            parameters=result.parameters if known else (),
            covariance=result.covariance if known else np.zeros((0, 0)),
            turns=result.turns,
            noise_std=result.noise_std if known else np.zeros(3),
            model=info.model if info else "",
            firmware=info.firmware if info else "",
            gyro_range=info.gyro_range if info else 0.0,
            rate_hz=info.rate_hz if info else 0.0,
            temperature_c=self.tracker.temperature_c,
            who=self._who,
        )

    def _bias_of(self, calibration: Calibration) -> BiasState:
        bias, cov = calibration.bias, calibration.covariance[:3, :3]
        knobs, celsius = self.knobs.track.bias, calibration.temperature_c
        # When it was switched on is not known either.
        return start(bias, cov, self._now, knobs, temperature_c=celsius, powered=self._began)

    def _missing(self) -> str:
        return ", ".join(AXES[axis] for axis in range(3) if axis not in self._done_axes)

    def _rate(self) -> float:
        if self._first_time is None or self._latest <= self._first_time:
            return 0.0
        return (self.sequence.seen - 1) / (self._latest - self._first_time)


def _bias_in(rest: Rest) -> RestBias:
    return RestBias(rest.bias, rest.bias_cov, rest.rounding_var, rest.middle, rest.end)
