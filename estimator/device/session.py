"""One device from its first sample on: readings in; corrected rates, calibrations and a status out.

A pure core: no clock, no bus, no store. Time is the device's own, in the samples; what was remembered of earlier boots
is handed in. What a block of device time teaches (`device.blocks`) is used from the end of the next one on: any batching of the
same samples gives the same corrected rates, and whoever runs it may learn meanwhile, when there is time.
"""

from collections.abc import Iterable
from functools import partial
from weakref import proxy

import numpy as np

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code, Sentence, Sentences
from bridge.wire.messages import NO_REST_S, Calibration, DeviceInfo, Quality, SampleBatch, State, Status
from bridge.wire.refusal import Reason
from estimator.calibration.result import Result
from estimator.device.batch_correction import Cut, batch_of, correct
from estimator.device.boot_estimation import BootEstimation, BootEstimationState
from estimator.device.calibration_progress import CalibrationProgress
from estimator.device.correction import Correction
from estimator.device.lifecycle import Event, Lifecycle
from estimator.device.outcome import Outcome
from estimator.device.prior_knowledge import PriorKnowledge
from estimator.device.sequence_numbers import SequenceNumbers
from estimator.device.session_knobs import SessionKnobs
from estimator.device.window_summary import Second
from estimator.geometry.gyro_model import axis_names
from estimator.samples.blocks import BLOCK_S, SHORT_S, Blocks
from estimator.samples.finite import runs
from estimator.samples.sample_buffer import CELSIUS, TIME, Samples, known
from estimator.state import StateStruct, decode, encode
from estimator.stillness.detector import too_seldom
from estimator.tracking.bias_filter import BiasState
from estimator.tracking.temperature_law import TemperatureLaw
from estimator.tracking.tracker import Tracker

#: of what `state` gives: another is not gone on with
VERSION = 1
#: counted under this: turns that did not come along when another estimator took the device over
TURNS_LOST = "turns lost with an estimator"
#: after a silence this long the bias is less certain from the first sample on, not only once a second was judged
SILENCE_S = 5.0


class SessionState(StateStruct):
    """A device's session as of the sample with the number `next`, the first that nothing was learnt from.

    begun_s, length_s: device time of that sample, if it is known, and length of its block. latest_s: device time of the sample
    before. clock: see Blocks.
    applied, ready: what corrects that block, and the one after it unless more is learnt. life: state, the one before, and both
    reasons.
    """

    version: int
    device: str
    boot: int
    next: int
    first: int
    last_heard_ns: int
    begun_s: float | None
    length_s: float
    latest_s: float
    clock: tuple[float | None, float]
    applied: Correction
    ready: Correction
    life: tuple[str, str, Sentences, Sentences]
    learnt: BootEstimationState


class DeviceSession:
    """The life of one device across its boots; `began`, device s, if it is known when the first of them begins.

    sequence: the counts it goes on with.
    """

    def __init__(
        self,
        device: str,
        knobs: SessionKnobs | None = None,
        began: float = 0.0,
        sequence: SequenceNumbers | None = None,
    ) -> None:
        self.device = device
        self.knobs = knobs or SessionKnobs()
        self.life = Lifecycle()
        self.sequence = sequence or SequenceNumbers()
        self.info: DeviceInfo | None = None
        self.last_heard_ns = 0
        #: whether somebody looks at windows of it: then what they are made of is kept
        self.windowed = False
        self._away_s = 0.0  # by the host's clock, before what was admitted last
        self._begin(began)
        self._unused = True  # since it was begun

    # ---- boots ----------------------------------------------------------------------------------------------------

    def begin_boot(
        self,
        boot: int,
        device_time: float,
        remembered: PriorKnowledge | None,
        law: TemperatureLaw | None = None,
        temperature_c: float | None = None,
    ) -> Outcome:
        """The device has started anew (or we have): forget this boot's calibration, then use what is remembered.

        law: what earlier boots taught of temperature. temperature_c: the device's now.
        """
        outcome = self.learn()  # what came of the one before
        first, again = self.boot is None, boot == self.boot and self.sequence.next is None
        self.sequence.begin(boot)
        if not self._unused or device_time != self.learnt.began or law is not None:
            self._begin(device_time, law)
        self._unused = False
        why = Code.WARMING_UP() if first else Code.RESTARTED()
        self.life.on(Event.BOOTED, () if again else (why,))  # again: nothing was taken of it yet
        outcome.changed = True
        outcome.said.append(f"boot {boot:016x}" + ("" if first else ", recalibration needed"))
        calibration = None if remembered is None else remembered.calibration
        if remembered is not None and calibration is not None and calibration.boot == boot:
            self._restore(remembered, calibration, temperature_c)
            outcome.said.append(f"calibration {calibration.id} of this boot restored")
        elif calibration is not None:
            self.believe(calibration)
        if remembered is not None and self.learnt.resume(remembered, temperature_c):
            self._apply()
            outcome.said.append("bias of this boot restored")
        return outcome

    def _begin(self, device_time: float, law: TemperatureLaw | None = None) -> None:
        # What it has learnt would else keep a session that is no more, until Python looks for cycles.
        made = partial(_as_message, proxy(self))
        self.learnt = BootEstimation(self.knobs, device_time, law, self.life, self.sequence.events, made)
        self._blocks = Blocks(device_time)
        #: what is applied now, and from the end of this block on
        self._applied = self._ready = self.learnt.correction()
        #: the last whole block in the buffer, while nothing is learnt from it yet
        self._lesson: tuple[int, int] | None = None
        self._lesson_applied = self._applied  # to that block, which was so long, s
        self._lesson_s = self._blocks.length_s

    def _lost_turns(self, axes: tuple[int, ...], outcome: Outcome) -> None:
        if self.learnt.under_way is None:
            return
        lost = Code.TURNS_LOST(axes=axis_names(axes))
        self.learnt.scratch = (lost,)
        self.sequence.events.add(TURNS_LOST, len(axes))
        outcome.said.append(english(lost))

    def start_over(self, why: Sentences) -> Outcome:
        """It is not what it was: nothing known of it holds any more. Its samples go on."""
        blocks = self._blocks.anew()
        self._begin(blocks.latest)
        self._blocks = blocks
        self.learnt.scratch = why
        self.life.on(Event.CHANGED, (Code.HOLD_STILL(),))
        return Outcome(changed=True, said=[english(*why)])

    def _restore(self, remembered: PriorKnowledge, calibration: Calibration, temperature_c: float | None) -> None:
        self.learnt.restore(remembered, calibration, temperature_c)
        if remembered.asked is not None:
            self.recalibrate(*remembered.asked)
        self._apply()

    def believe(self, calibration: Calibration) -> None:
        """Use the scale factors of an earlier boot until this one is calibrated."""
        if self.calibration is None:
            self.learnt.believe(calibration)
            self._apply()

    def moves(self, moves: float) -> None:
        """How far its scale moves from boot to boot (relative), by earlier ones."""
        if self.learnt.moves(moves):
            self._apply()

    def adopt(self, remembered: PriorKnowledge, calibration: Calibration) -> None:
        """What was known with a calibration of this very boot, by who had the device meanwhile; it ends one that is under way."""
        self._restore(remembered, calibration, self.tracker.thermometer.reading)
        self.learnt.scratch = ()

    # ---- whole, as bytes --------------------------------------------------------------------------------------------

    def state(self) -> bytes | None:
        """All that is known of this boot, but for the turns of a calibration under way; None before any of its samples came.

        For `restored`: with the samples from the number on that it tells, it goes on bit for bit.
        """
        buffer, next_ = self._blocks.buffer, self.sequence.next
        if self.boot is None or next_ is None:
            return None
        if self._lesson is None:
            end, applied, length_s = buffer.end, self._applied, self._blocks.length_s
            begun_s, next_ = self._blocks.begun or (None, next_)
        else:  # which is before the block that is not over
            end, applied, length_s = self._lesson[0], self._lesson_applied, self._lesson_s
            begun_s, next_ = buffer.rows(end, end + 1).item(0, TIME), buffer.place(end)[0]
        clock = self._blocks.clock if end else (None, 0.0)  # nothing came before
        latest_s = buffer.rows(end - 1, end).item(0, TIME) if end > buffer.begin else self.learnt.began
        return encode(
            SessionState(
                VERSION,
                self.device,
                self.boot,
                next_,
                self.sequence.first,
                self.last_heard_ns,
                begun_s,
                length_s,
                latest_s,
                clock,
                applied,
                self._ready,
                self.life.saved,
                self.learnt.saved(buffer, end),
            )
        )

    @classmethod
    def restored(
        cls,
        state: bytes,
        calibration: Calibration | None,
        device: str,
        knobs: SessionKnobs | None = None,
        sequence: SequenceNumbers | None = None,
    ) -> "DeviceSession":
        """The session that goes on from a state of a device, with the calibration that went with the state.

        It is to be fed from sample number `sequence.next` on, some of which have been corrected before. Turns of a calibration
        under way are to be taken again, which is said.
        Raises ValueError: the state is damaged, or of another device, version or calibration.
        """
        saved = decode(state, SessionState)
        if (saved.version, saved.device) != (VERSION, device):
            raise ValueError(f"a state of {saved.device!r}, version {saved.version}: expected {device!r}, {VERSION}")
        if saved.length_s not in (BLOCK_S, SHORT_S):
            raise ValueError(f"damaged state: a block is {saved.length_s} s long")
        session = cls(device, knobs, saved.learnt.began, sequence)
        buffer = session.learnt.go_on(saved.learnt, calibration, saved.boot)
        for correction in (saved.applied, saved.ready):
            correction.check()
            if correction.quality is Quality.GOOD and session.calibration is None:
                raise ValueError("damaged state: GOOD, without a calibration of this boot")
        session.life.resume(saved.life)
        session._blocks = Blocks(saved.latest_s)
        session._blocks.length_s = saved.length_s
        session._blocks.resume(buffer, saved.clock, saved.begun_s)
        session._applied, session._ready = saved.applied, saved.ready
        session.sequence.resume(saved.boot, saved.first, saved.next)
        session.last_heard_ns, session._unused = saved.last_heard_ns, False
        if saved.learnt.under_way:
            session.life.on(Event.CANCEL_TO_START, (Code.HOLD_STILL(),))
        if saved.learnt.turned:
            session._lost_turns(saved.learnt.turned, Outcome())
        return session

    # ---- samples --------------------------------------------------------------------------------------------------

    @property
    def boot(self) -> int | None:
        """The boot whose samples are taken."""
        return self.sequence.boot

    @property
    def calibration(self) -> Calibration | None:
        """Of this boot."""
        return self.learnt.calibration

    @property
    def prior(self) -> Calibration | None:
        """Of an earlier boot, under the same restore key."""
        return self.learnt.prior

    @property
    def tracker(self) -> Tracker:
        """Of this boot's bias."""
        return self.learnt.tracker

    @property
    def applied(self) -> Correction:
        """What is applied to the samples that come next."""
        return self._applied

    def begins_earlier(self, samples: Samples) -> bool:
        """Whether these are of the time before this boot was taken to begin, and nothing of it was taken yet."""
        return self.sequence.next is None and samples.first_s < self.learnt.began

    def handle(self, batch: SampleBatch) -> Outcome:
        """Take a batch of the current boot, as of a recording, correct it and learn from it; what is not finite is counted."""
        samples, cuts = Samples.of(batch), list[Cut]()
        first, outcome = self._admit(samples)
        finite = runs(batch, first) if first < samples.n else []
        self.sequence.drop(Reason.NON_FINITE, samples.n - first - sum(end - begin for begin, end in finite))
        for begin, end in finite:
            outcome = self._put(samples.part(begin, end), 0, cuts, outcome)
        outcome = outcome or Outcome()
        outcome.corrected = [batch_of(cut, rates) for cut, rates in zip(cuts, correct(cuts), strict=True)]
        self._learn(outcome)
        return outcome

    def take(self, samples: Samples, cuts: list[Cut]) -> Outcome | None:
        """Take samples of the current boot (see Sequence.is_new_boot), all finite; late or repeated ones are counted.

        What is to be corrected by what is added to `cuts`; what came of earlier samples is returned, if anything did.
        """
        first, outcome = self._admit(samples)
        return outcome if first == samples.n else self._put(samples, first, cuts, outcome)

    @property
    def to_learn(self) -> bool:
        """Whether there is a whole block that nothing was learnt from yet."""
        return self._lesson is not None

    def learn(self) -> Outcome:
        """What the last whole block teaches; by itself at the end of the next one, from which on it is applied."""
        outcome = Outcome()
        self._learn(outcome)
        return outcome

    def _admit(self, samples: Samples) -> tuple[int, Outcome | None]:
        """Count samples that came; how many at their start are not to be used, and what comes of it that they do."""
        first = self.sequence.fresh(samples)
        if first == samples.n:
            return first, None
        self._away_s = max(0.0, (samples.receive_time_ns - self.last_heard_ns) / 1e9 / samples.clock_rate)
        self.last_heard_ns = samples.receive_time_ns
        if not (self.life.away and self.life.on(Event.HEARD)):
            return first, None
        self._apply()
        return first, Outcome(changed=True, said=["heard again"])

    def _put(self, samples: Samples, first: int, cuts: list[Cut], outcome: Outcome | None) -> Outcome | None:
        """Take samples but the first few, and tell what is to be corrected by what."""
        blocks, start = self._blocks, first
        if blocks.went_back(samples.rows.item(first, TIME) if first else samples.first_s, self._away_s):
            self.sequence.events.add("device clock went back")
        for edge, now, before in blocks.put(samples, first):
            applied, outcome = self._applied, outcome or Outcome()
            if now - before > SILENCE_S:
                self._end_block(outcome, (now, known(samples.rows.item(edge, CELSIUS))))
            else:
                self._end_block(outcome)
            if edge > start and self._applied is not applied and not self._applied.same(applied):
                cuts.append(Cut(samples, applied, start, edge))
                start = edge
        cuts.append(Cut(samples, self._applied, start, samples.n))
        return outcome

    def _end_block(self, outcome: Outcome, resumed: tuple[float, float | None] | None = None) -> None:
        """A block ends, which is the next lesson: from here on all is applied that was learnt from those before.

        resumed: device time of the next sample, and how warm it is then, where a silence is before it.
        """
        self._learn(outcome)
        self._lesson_s = self._blocks.length_s
        self._blocks.length_s = SHORT_S if self.learnt.awaited else BLOCK_S
        if resumed is not None:
            self.learnt.resumed(*resumed)
            self._ready = self.learnt.correction()
        self._lesson, self._lesson_applied = self._blocks.end_block(), self._applied
        self._applied = self._ready

    def _learn(self, outcome: Outcome) -> None:
        if self._lesson is None:
            return
        (begin, end), self._lesson, buffer = self._lesson, None, self._blocks.buffer
        of = self.device, self.boot or 0
        if self.windowed:
            block = buffer.rows(begin, end).copy(), buffer.places(begin, end).copy()
            outcome.seconds.append(Second(*of, *block, self._lesson_applied))
        if self.learnt.learn(buffer, end, of, outcome):  # where nothing is learnt batches stay whole
            self._ready = self.learnt.correction()

    def end(self) -> Outcome:
        """The stream is over: what its last blocks teach, without any more samples."""
        outcome = Outcome()
        self._end_block(outcome)
        self._learn(outcome)
        return outcome

    # ---- people and time ------------------------------------------------------------------------------------------

    def recalibrate(self, who: str, reason: str) -> Sentence | None:
        """Ask for three new turns; the present calibration stays in use until they are taken. None, or why not."""
        if not self.life.on(Event.RECALIBRATE):
            code = Code.ALREADY_DUE if self.life.state is State.WARMING else Code.NOT_HEARD
            return code(device=self.device)
        self.learnt.under_way = CalibrationProgress(self.knobs, who, reason)
        why = (Code.REQUEST_REASON(words=reason),) if reason else ()
        self.life.say((Code.RECALIBRATION_ASKED(who=who), *why, Code.HOLD_STILL()))
        return None

    def cancel(self, who: str) -> Sentence | None:
        """Stop a calibration under way; the old one stays. None, or why not."""
        event = Event.CANCEL_TO_START if self.calibration is None else Event.CANCEL_TO_TRACKING
        if not self.life.on(event):
            return Code.NOTHING_TO_CANCEL(device=self.device)
        if self.tracker.doubt.stands:
            self.life.on(Event.DOUBTED)
        self.learnt.cancel(who)
        return None

    def silence(self, reason: Sentences, event: Event = Event.SILENT) -> bool:
        """No samples come any more that can be used, as the event says, for this reason as it is now; True when that is news."""
        if not self.life.on(event, reason):
            unknown = (Event.OUTDATED, Event.UNREACHABLE) if self.life.state is State.UNKNOWN else ()
            if event in unknown or (self.life.state, event) == (State.LOST, Event.SILENT):
                self.life.reason = reason
            return False
        self._blocks.own()
        self._apply()
        return True

    # ---- what is known --------------------------------------------------------------------------------------------

    def status(
        self,
        time_ns: int,
        *,
        bridge: str = "",
        refused_bridges: tuple[str, ...] = (),
        epoch: int = 0,
        silent_s: float = 0.0,
        more: Iterable[tuple[str, int]] = (),
    ) -> Status:
        """All of it, for the bus, with what is known of it outside the core: since when nothing came, events counted there."""
        known, learnt = self._ready, self.learnt
        seldom = self._too_seldom() if self.life.state is State.AWAITING_STILL else ()
        reason = seldom or self.life.reason
        if not self.life.away:  # whatever else is said of it
            reason += tuple(one for one in self.tracker.doubt.why if one not in reason)
        events = self.sequence.events.as_dict() | self.tracker.events
        events.update(more)
        return Status(
            device=self.device,
            boot=self.boot or 0,
            time_ns=time_ns,
            state=self.life.state,
            quality=known.quality,
            reason=reason + learnt.scratch,
            progress=learnt.progress,
            axes_done=learnt.turned,
            bias=tuple(known.model.bias.tolist()),
            bias_std=tuple(known.bias_std.tolist()),
            scale=tuple(known.model.matrix.diagonal().tolist()),
            calibration=known.calibration,
            calibrated_time_ns=self.calibration.time_ns if self.calibration else 0,
            evidence_age_s=min(self.tracker.evidence_age(learnt.now) + silent_s, NO_REST_S),
            temperature_c=self.tracker.thermometer.reading,
            rate_hz=self._rate(),
            samples_in=self.sequence.samples_in,
            samples_out=self.sequence.samples_out,
            dropped=self.sequence.dropped.as_dict(),
            events=events,
            bridge=bridge,
            refused_bridges=refused_bridges,
            epoch=epoch,
        )

    def count_event(self, name: str) -> int:
        """Count something that happened to this device outside the core."""
        return self.sequence.events.add(name)

    def checkpoint(self) -> BiasState | None:
        """The bias as it would be restored; of a calibrated boot, or one that is sure of it, of which anything came."""
        return None if self.sequence.next is None else self.learnt.bias()

    def _apply(self) -> None:
        """Use all that is known at once: it does not come from samples."""
        self._applied = self._ready = self.learnt.correction()

    def _too_seldom(self) -> Sentences:
        told = self.info
        rate_hz = max(told.rate_hz, told.measured_rate_hz) if told is not None else 0.0
        return too_seldom(rate_hz, self.knobs.stillness)

    def _rate(self) -> float:
        seconds = self._blocks.seconds
        return (self.sequence.seen - 1) / seconds if seconds > 0 else 0.0


def _as_message(session: DeviceSession, result: Result, who: str, now_ns: int) -> Calibration:
    info = session.info
    boot = session.boot or 0
    # The wire takes no infinity: what was not estimated is not named.
    known = bool(np.all(np.isfinite(result.covariance)))
    return Calibration(
        device=session.device,
        boot=boot,
        id=f"{session.device}-{boot:016x}-{now_ns // 1_000_000:x}",
        time_ns=now_ns,
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
        temperature_c=session.tracker.thermometer.reading,
        who=who,
    )
