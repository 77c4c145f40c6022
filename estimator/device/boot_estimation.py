"""Calibration and bias estimation in one boot: blocks of samples in; calibration, bias and the correction to apply out."""

from collections import deque
from collections.abc import Callable

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code, Sentences
from bridge.wire import messages
from bridge.wire.messages import Calibration, State, Verdict
from bridge.wire.receipts import MAX_RECEIPTS
from bridge.wire.refusal import Tally
from estimator.calibration.capture import Rest
from estimator.calibration.result import Result
from estimator.calibration.session_events import Expired, Finished, Ignored, Progress, RestFound, TurnFound
from estimator.device.calibration_progress import CalibrationProgress
from estimator.device.correction import Correction, believed, choose
from estimator.device.lifecycle import Event, Lifecycle
from estimator.device.outcome import Outcome
from estimator.device.prior_knowledge import PriorKnowledge, calibrated_bias, wider
from estimator.device.receipts import as_message
from estimator.device.revision_sequences import RevisionSequences
from estimator.device.saved_samples import SavedSamples
from estimator.device.session_knobs import SessionKnobs
from estimator.device.worn_calibration import METHOD, combined, learnt
from estimator.geometry.gyro_model import reading_std
from estimator.samples.sample_buffer import Floats, SampleBuffer
from estimator.state import StateStruct
from estimator.stillness.detector import Stillness, StillnessState, Windows
from estimator.tracking.bias_filter import BiasState
from estimator.tracking.evidence import Receipt
from estimator.tracking.seconds import Second
from estimator.tracking.temperature_law import TemperatureLaw
from estimator.tracking.tracker import RestBias, Tracker, TrackerState

#: builds the published calibration message from a result, the person who asked for it, and the host time, ns
AsMessage = Callable[[Result, str, int], Calibration]
#: s for which the status says that a calibration was cancelled, before the normal reason returns
CANCELLED_S = 60.0
_GOES_ON = (Code.CALIBRATION_GOES_ON(),)
_HOLD_STILL = (Code.HOLD_STILL(),)
_WAS_DOUBTED = (Code.BIAS_WAS_DOUBTED(),)
_CONFIRMED = (Code.BIAS_CONFIRMED(),)


class BootEstimationState(StateStruct):
    """Saved state of a boot's estimation, without the samples of a calibration in progress and the smoother's history.

    calibration: id of the calibration in use, which is stored elsewhere. under_way: whether a calibration is in progress.
    asked: who asked for it, and why. turned: axes whose turns were taken. reached: sequence number and host time, ns, of
    the last sample the bias was estimated from.
    """

    tracker: TrackerState
    stillness: StillnessState
    taken: SavedSamples
    calibration: str
    under_way: bool
    asked: tuple[str, str] | None
    turned: tuple[int, ...]
    began: float
    now: float
    scratch: Sentences
    moves: float | None
    silent_until: float
    silent_c: float | None
    cancelled: Sentences
    cancelled_until: float
    slope_learnt: bool
    reached: tuple[int, int] | None


class BootEstimation:
    """Estimation in a boot that began at device time `began`, s.

    Reports events to `life` and counts others in `events`; `as_message` turns a result into a calibration message.
    """

    def __init__(
        self,
        knobs: SessionKnobs,
        began: float,
        law: TemperatureLaw | None,
        life: Lifecycle,
        events: Tally,
        as_message: AsMessage,
    ) -> None:
        self.began = began
        #: calibration of this boot, and of an earlier one under the same restore key
        self.calibration: Calibration | None = None
        self.prior: Calibration | None = None
        #: calibration by hand that a worn one continues, to return to
        self._by_hand: Calibration | None = None
        #: why earlier knowledge is void; part of the status until the next calibration
        self.scratch: Sentences = ()
        self.under_way: CalibrationProgress | None = CalibrationProgress(knobs)
        self._moves: float | None = None
        self._silent_until = float("-inf")  # device time of the first sample after the latest silence, s
        self._silent_c: float | None = None  # the temperature then, °C
        #: device time of the last window that was judged, s
        self.now = began
        #: reason shown after a cancelled calibration, and the device time until which it is shown, s
        self._cancelled: Sentences = ()
        self._cancelled_until = float("inf")
        self._slope_learnt = False  # whether the slope of a calibrated bias was learnt under a law
        self._knobs, self._law, self._life, self._events, self._as_message = knobs, law, life, events, as_message
        self._stillness = Stillness(knobs.stillness)
        self._belief = believed(None, None, knobs.prior)
        self.tracker = Tracker(knobs.track, began, self._belief.model, self._belief.bias_std, law)
        self._past = RevisionSequences()
        #: the filter's latest receipts, until a status tells them
        self.receipts = deque[messages.Receipt](maxlen=MAX_RECEIPTS)

    def saved(self, buffer: SampleBuffer, end: int) -> BootEstimationState:
        """State to save with `encode` at once; the samples below number `end` of the buffer have been learnt from."""
        used = self.calibration or self.prior
        return BootEstimationState(
            self.tracker.saved(),
            self._stillness.saved,
            SavedSamples.of(buffer, end),
            "" if used is None else used.id,
            self.under_way is not None,
            self.asked,
            self.turned,
            self.began,
            self.now,
            self.scratch,
            self._moves,
            self._silent_until,
            self._silent_c,
            self._cancelled,
            self._cancelled_until,
            self._slope_learnt,
            self.reached,
        )

    def go_on(self, saved: BootEstimationState, calibration: Calibration | None, boot: int) -> SampleBuffer:
        """Restore a saved state in a boot without other knowledge; returns the buffer of the samples so far.

        calibration: the calibration that the state names. Raises ValueError when the state is damaged or names another
        calibration.
        """
        if saved.calibration != ("" if calibration is None else calibration.id):
            raise ValueError(
                f"the state goes with calibration {saved.calibration or 'none'}, which is not the one given"
            )
        own = calibration is not None and calibration.boot == boot
        self.calibration, self.prior = (calibration, None) if own else (None, calibration)
        self._belief = believed(self.calibration, self.prior, self._knobs.prior, saved.moves)
        who, why = saved.asked or ("", "")
        self.under_way = CalibrationProgress(self._knobs, who, why) if saved.under_way else None
        buffer = saved.taken.buffer()
        self._stillness.resume(saved.stillness)
        first, end = saved.taken.first, saved.stillness.next
        if not first <= end <= buffer.end:
            raise ValueError("damaged state: samples are missing")
        self.tracker.go_on(saved.tracker, self._belief.model, first, buffer.rows(first, end))
        self._law = saved.tracker.law
        self.began, self.now, self.scratch, self._moves = saved.began, saved.now, saved.scratch, saved.moves
        self._silent_until, self._silent_c = saved.silent_until, saved.silent_c
        self._cancelled, self._cancelled_until = saved.cancelled, saved.cancelled_until
        self._slope_learnt = saved.slope_learnt
        if saved.reached is not None:
            self._past.note(self.tracker.time, *saved.reached)
        return buffer

    # ---- earlier knowledge, or another estimator's -----------------------------------------------------------------

    def restore(self, remembered: PriorKnowledge, calibration: Calibration, temperature_c: float | None) -> None:
        """Continue with a calibration of this boot, and with the remembered bias."""
        self.calibration, self.prior, self.under_way = calibration, None, None
        self._belief = believed(calibration, None, self._knobs.prior)
        knobs = self._knobs.track
        kept = remembered.bias_at(self.now, knobs.bias_std)
        if kept is None:  # nor is the power-up time known
            kept = wider(calibrated_bias(calibration, self.now, self.began, knobs.bias, self._law), knobs.bias_std)
        self._slope_learnt = remembered.bias is not None or self._law is not None
        self.tracker.restored(self._belief.model, kept, self.now, temperature_c)
        self._life.on(Event.RESTORED, _GOES_ON)
        if remembered.doubted:
            self.tracker.doubt.why = (Code.CALIBRATED(), *_WAS_DOUBTED)
            self._life.on(Event.DOUBTED, self.tracker.doubt.why)

    def accept(self, calibration: Calibration, reason: Sentences) -> None:
        """Use a calibration that the device made itself in this boot; a bias that rests have shown is kept."""
        if self.tracker.sure and not self.tracker.doubt.stands:
            self.calibration, self.prior, self.under_way = calibration, None, None
            self._belief = believed(calibration, None, self._knobs.prior)
            self.tracker.rescaled(self._belief.model)
            self._slope_learnt = self._law is not None
            self._life.on(Event.RESTORED)
        else:
            self.restore(PriorKnowledge(calibration, None), calibration, self.tracker.thermometer.reading)
        self.scratch = ()
        self._life.say(reason)

    @property
    def seen(self) -> tuple[Floats, Floats] | None:
        """Bias (3,) that rests of this boot have shown and its standard deviation (3,), rad/s; None while not sure."""
        return (self.tracker.bias, self.tracker.std) if self.tracker.sure else None

    @property
    def noise_std(self) -> Floats:
        """White noise (3,) of a reading, rad/s: as rests show it, or that of the model."""
        return reading_std(self._stillness.noise_std) if self._stillness.noise_known else self._belief.model.noise_std

    def resume(self, remembered: PriorKnowledge, temperature_c: float | None) -> bool:
        """Continue with the remembered bias of an uncalibrated boot; False if there is none."""
        kept = remembered.bias_at(self.now, self._knobs.track.bias_std)
        if kept is None or self.calibration is not None:
            return False
        self.tracker.restored(self._belief.model, kept, self.now, temperature_c)
        if remembered.doubted:
            self.tracker.doubt.why = _WAS_DOUBTED
        return True

    def believe(self, calibration: Calibration) -> None:
        """Use the scale factors of an earlier boot's calibration until this boot is calibrated."""
        self.prior = calibration
        self._belief = believed(None, calibration, self._knobs.prior, self._moves)
        if self.tracker.sure:
            self.tracker.rescaled(self._belief.model)
        else:
            self.tracker.supposed(self._belief.model, self._belief.bias_std, self.now)

    def moves(self, moves: float) -> bool:
        """Set how far the scale changes from boot to boot (relative std); returns whether the model changed."""
        self._moves = moves
        if self.prior is None:
            return False
        self._belief = believed(None, self.prior, self._knobs.prior, moves)
        self.tracker.rescaled(self._belief.model)
        return True

    def expect(self, law: TemperatureLaw) -> None:
        """Use a temperature law that became available only after the boot had begun."""
        self._law = law
        if self.calibration is not None and self._slope_learnt:
            self.tracker.follow(law)
        else:
            self.tracker.expect(law)
            self._slope_learnt = self.calibration is not None

    def resumed(self, time: float, celsius: float | None) -> None:
        """Note the end of a silence: device time, s, and temperature, °C, of the next sample.

        Until the tracker reaches that time, `correction` predicts the bias to it.
        """
        self._silent_until, self._silent_c = time, celsius

    # ---- samples --------------------------------------------------------------------------------------------------

    def learn(self, buffer: SampleBuffer, end: int, of: tuple[str, int], outcome: Outcome) -> bool:
        """Learn from the samples of a buffer below number `end`; returns whether the correction has changed.

        of: device and boot of the samples. Results and events go to `outcome`.
        """
        begin, belief = self.tracker.time, self._belief
        windows = self._stillness.take(buffer, end)
        windows = windows.part(self._warm_up(windows, buffer, outcome))
        if self.under_way is not None and len(windows):
            self.under_way.add(windows)
        seconds = deque(self.tracker.seconds.take(windows))
        for i, (begun, now, last, still) in enumerate(windows.heads):
            self.now = now
            while seconds and seconds[0][0] == i:
                self._second(seconds.popleft()[1], buffer, of, outcome)
            if (under_way := self.under_way) is not None:
                for progress in under_way.judge(begun, now, still=still):
                    self._progress(progress, under_way, outcome, buffer.place(last)[1])
            if now >= self._cancelled_until:
                self._as_it_is(outcome)
        return self.tracker.time != begin or self._belief is not belief

    def _warm_up(self, windows: Windows, buffer: SampleBuffer, outcome: Outcome) -> int:
        """Process the windows while the device warms up; returns their number."""
        heads = windows.heads if self._life.state is State.WARMING else []
        for i, (_, now, last, _) in enumerate(heads):
            self.now, window = now, windows.part(i, i + 1)
            if self.under_way is not None:
                self.under_way.add(window)
            self.tracker.skip(window)
            buffer.forget(last)
            warm = now - self.began >= self._knobs.warming_s or self.began > self._knobs.warming_s
            if warm and self._happens(Event.WARM, _HOLD_STILL, outcome):
                return i + 1
        return len(heads)

    def _second(self, second: Second, buffer: SampleBuffer, of: tuple[str, int], outcome: Outcome) -> None:
        """Track the bias over a second, and revise the bias of a gap in the evidence that it ends."""
        sequence, time_ns = buffer.place(second.last)
        receipts = self.tracker.learn(second)
        self.receipts += [as_message(one, time_ns - round((second.end - one.time) * 1e9)) for one in receipts]
        self._heard(receipts, outcome)
        self._past.note(second.end, sequence, time_ns)
        buffer.forget(second.last)
        if self.tracker.surer:
            self._learnt_worn(outcome, time_ns)
        if (improved := self.tracker.improved()) is not None:
            used = self._belief
            revision = self._past.revision(of, time_ns, used.calibration, used.model.matrix, *improved)
            outcome.revisions += [] if revision is None else [revision]

    def _heard(self, receipts: list[Receipt], outcome: Outcome) -> None:
        """Process the tracker's receipts of a second."""
        for receipt in receipts:
            if not receipt.accepted:
                self._events.add(f"{receipt.kind}: {receipt.reason}")
            elif self._doubted:
                self._confirm(outcome)
        if self.tracker.law_refuted and self._law is not None:
            self._law = None
            self._events.add("temperature law disagrees")
            outcome.said.append(english(Code.TEMPERATURE_LAW_REFUTED()))
        if why := self.tracker.doubts(self.now):
            self._give_up_worn()
            if not self._happens(Event.DOUBTED, why, outcome):
                self._say_beside(why, outcome)

    def _confirm(self, outcome: Outcome) -> None:
        """End a doubt of the bias when the latest rests have resolved it."""
        if self.tracker.trusts() and not self._happens(Event.CONFIRMED, (Code.CALIBRATED(), *_CONFIRMED), outcome):
            self._say_beside(_CONFIRMED, outcome)

    def _say_beside(self, news: Sentences, outcome: Outcome) -> None:
        """Report news while a calibration is in progress: the device's own reason stays the next step for the operator."""
        outcome.changed = True
        outcome.said.append(english(*news))

    @property
    def _doubted(self) -> bool:
        """Whether a rest can confirm a doubted bias."""
        return self.tracker.doubt.stands or self._life.state is State.DEGRADED

    # ---- calibration ----------------------------------------------------------------------------------------------

    def _progress(self, progress: Progress, under_way: CalibrationProgress, outcome: Outcome, now_ns: int) -> None:
        """Handle a step of a calibration in progress; now_ns: host time of the window's last sample."""
        match progress:
            case RestFound():
                self._happens(Event.RESTED, (Code.TURN_NOW(axes=under_way.missing),), outcome)
            case TurnFound():
                self._happens(Event.TURNED, under_way.said(progress), outcome)
            case Expired() | Ignored():
                if isinstance(progress, Ignored):
                    self._events.add("movement ignored")
                needed = under_way.said(progress)
                self._life.say(needed)
                outcome.changed = True
                outcome.said.append(english(*needed))
            case Finished(result, rest):
                self._finish(result, rest, under_way, outcome, now_ns)

    def _finish(
        self, result: Result, rest: Rest, under_way: CalibrationProgress, outcome: Outcome, now_ns: int
    ) -> None:
        used = self.calibration
        if result.verdict is Verdict.ACCEPTED and used is not None and used.method == METHOD:
            result = combined(result, used)
        made = self._as_message(result, under_way.who, now_ns)
        outcome.calibrations.append(made)
        if result.verdict is not Verdict.ACCEPTED:
            under_way.refused = result.reason
            self._happens(Event.NOT_CALIBRATED, result.reason, outcome)
            return
        self.calibration, self.prior, self.under_way, self.scratch = made, None, None, ()
        self._belief = believed(self.calibration, None, self._knobs.prior)
        self.tracker.calibrated(self._belief.model, result.covariance[:3, :3], result.bias_time, _bias_in(rest))
        self._slope_learnt = self._law is not None
        self._happens(Event.CALIBRATED, (Code.CALIBRATED(), *result.reason), outcome)

    def _learnt_worn(self, outcome: Outcome, now_ns: int) -> None:
        """Correct by the matrix that gravity has taught while the device was worn; turns under way go on."""
        before = self.calibration
        if before is not None and before.method != METHOD:
            self._by_hand = before
        made = self._as_message(learnt(self.tracker, self.noise_std, before.turns if before else ()), "", now_ns)
        outcome.calibrations.append(made)
        self.calibration, self.prior = made, None
        self._belief = believed(made, None, self._knobs.prior)
        self.tracker.corrected_by(self._belief.model)
        self._say_beside(made.reason, outcome)

    def _give_up_worn(self) -> None:
        """Return to the calibration by hand after a doubt of the bias: the matrix learnt since may have caused it."""
        if self._by_hand is not None and self.calibration is not None and self.calibration.method == METHOD:
            self.calibration, self._by_hand = self._by_hand, None
            self._belief = believed(self.calibration, None, self._knobs.prior)
            self.tracker.rescaled(self._belief.model)

    def cancel(self, who: str) -> None:
        """Cancel a calibration in progress; an old one stays in use, without one the calibration starts over."""
        if self.calibration is None:
            self.under_way = CalibrationProgress(self._knobs)
            self._life.say((Code.CALIBRATION_CANCELLED(who=who), *_HOLD_STILL))
            return
        self.scratch, self.under_way = (), None
        self._cancelled = (Code.CALIBRATION_CANCELLED(who=who), Code.OLD_CALIBRATION_STAYS())
        self._cancelled_until = self.now + CANCELLED_S
        self._life.say(self._cancelled)

    def _as_it_is(self, outcome: Outcome) -> None:
        """Replace the notice of a cancelled calibration by the normal reason, unless another reason came since."""
        if self._life.goes_on == self._cancelled:
            self._life.say(self.tracker.doubt.why or _GOES_ON)
            outcome.changed = True
        self._cancelled_until = float("inf")

    def _happens(self, event: Event, reason: Sentences, outcome: Outcome) -> bool:
        before = self._life.state
        if not self._life.on(event, reason):
            return False
        outcome.changed = True
        outcome.said.append(f"{before.name} -> {self._life.state.name}: {english(*reason)}")
        return True

    # ---- estimates -------------------------------------------------------------------------------------------------

    @property
    def awaited(self) -> bool:
        """Whether a person waits for the next samples' result: a calibration's first rest, or one of its turns."""
        return self.under_way is not None and self.under_way.awaited

    @property
    def asked(self) -> tuple[str, str] | None:
        """Who asked for the recalibration in progress, and why; None without one."""
        return None if self.under_way is None else self.under_way.asked

    @property
    def turned(self) -> tuple[int, ...]:
        """Axes whose turns are taken, of a calibration in progress."""
        return () if self.under_way is None else self.under_way.turned

    @property
    def progress(self) -> float:
        """Progress of a calibration, 0 to 1; 1 when none is in progress."""
        return 1.0 if self.under_way is None else min(0.1 * self.tracker.sure + 0.3 * len(self.turned), 1.0)

    def bias(self) -> BiasState | None:
        """Bias to store for a restart; None while the boot is uncalibrated and its bias is not sure."""
        return self.tracker.worth_keeping if self.calibration is not None or self.tracker.sure else None

    @property
    def reached(self) -> tuple[int, int] | None:
        """Sequence number and host time, ns, of the last sample the bias was estimated from; None before the first."""
        return self._past.reached

    def correction(self) -> Correction:
        """Choose the correction to apply, from all that is known."""
        noise_std = reading_std(self._stillness.noise_std) if self._stillness.noise_known else None
        track = self.tracker
        bias, std = track.ahead(self._silent_until, self._silent_c)
        sure = track.sure and not track.doubt.stands and all(axis < self._knobs.track.bias_std for axis in std.tolist())
        knobs = self._knobs.track.bias
        return choose(
            self._belief,
            bias,
            std,
            noise_std,
            knobs.flicker,
            sure=sure,
            away=self._life.away,
            walk=knobs.rate_random_walk,
            unsure=track.unsure,
        )


def _bias_in(rest: Rest) -> RestBias:
    return RestBias(rest.bias, rest.bias_cov, rest.rounding_var, rest.middle, rest.end)
