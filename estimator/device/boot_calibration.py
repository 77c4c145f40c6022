"""Calibration within one boot: derives the gyro model in use from earlier boots and turns in progress."""

from collections.abc import Callable

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code, Sentences
from bridge.wire.messages import Calibration, Verdict
from bridge.wire.refusal import Tally
from estimator.calibration.capture import Rest
from estimator.calibration.result import Result
from estimator.calibration.session_events import Expired, Finished, Ignored, Progress, RestFound, TurnFound
from estimator.device.calibration_progress import CalibrationProgress
from estimator.device.correction import believed
from estimator.device.lifecycle import Event, Lifecycle
from estimator.device.outcome import Outcome
from estimator.device.prior_knowledge import PriorKnowledge, calibrated_bias, wider
from estimator.device.session_knobs import SessionKnobs
from estimator.device.worn_calibration import METHOD, combined, learnt
from estimator.geometry.gyro_model import axis_names, reading_std
from estimator.samples.sample_buffer import Floats
from estimator.stillness.detector import Stillness
from estimator.tracking.bias_state import BiasState
from estimator.tracking.temperature_law import TemperatureLaw
from estimator.tracking.tracker import RestBias, Tracker

#: builds the published calibration message from a result, the person who asked for it, and the host time, ns
AsMessage = Callable[[Result, str, int], Calibration]
#: s for which the status says that a calibration was cancelled, before the normal reason returns
CANCELLED_S = 60.0
_GOES_ON = (Code.CALIBRATION_GOES_ON(),)
_HOLD_STILL = (Code.HOLD_STILL(),)
_WAS_DOUBTED = (Code.BIAS_WAS_DOUBTED(),)


class BootCalibration:
    """Calibration, gyro model and bias tracker of one boot.

    began: device time of the boot's start, s. law: temperature law (bias against temperature) from earlier boots, or
    None.
    life: state table that receives the events of a calibration. events: counts of other events.
    as_message: converts a calibration result into a calibration message.
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
        #: device time of the last window that was judged, s
        self.now = began
        #: reason shown after a cancelled calibration, and the device time until which it is shown, s
        self._cancelled: Sentences = ()
        self._cancelled_until = float("inf")
        self._slope_learnt = False  # whether the slope of a calibrated bias was learnt under a law
        self._knobs, self._life, self._events, self._as_message = knobs, life, events, as_message
        self._stillness = Stillness(knobs.prior.noise_std)
        self._belief = believed(None, None, knobs.prior)
        self.tracker = Tracker(knobs.track, began, self._belief.model, self._belief.bias_std, law)

    def _use(self, calibration: Calibration | None, prior: Calibration | None = None) -> None:
        """Use a calibration of this boot, or else one of an earlier boot."""
        self.calibration, self.prior = calibration, prior
        self._belief = believed(calibration, prior, self._knobs.prior, self._moves)

    def restore(self, remembered: PriorKnowledge, calibration: Calibration, temperature_c: float | None) -> None:
        """Restore a calibration of this boot with the stored bias, for example after a restart of the estimator.

        remembered: stored bias of this boot, and whether it was in doubt. temperature_c: the device's temperature now,
        °C, or None.
        """
        self._use(calibration)
        self.under_way, knobs, law = None, self._knobs.track, self.tracker.law
        kept = remembered.bias_at(self.now, knobs.bias_std)
        if kept is None:  # nor is the power-up time known
            kept = wider(calibrated_bias(calibration, self.now, self.began, knobs.bias, law), knobs.bias_std)
        self._slope_learnt = remembered.bias is not None or law is not None
        self.tracker.restored(self._belief.model, kept, self.now, temperature_c)
        self._life.on(Event.RESTORED, _GOES_ON)
        if remembered.doubted:
            self.tracker.doubt.why = (Code.CALIBRATED(), *_WAS_DOUBTED)
            self._life.on(Event.DOUBTED, self.tracker.doubt.why)

    def accept(self, calibration: Calibration, reason: Sentences) -> None:
        """Use a calibration that the device made itself in this boot; a bias already measured in rests is kept.

        reason: text for the device's status.
        """
        if self.tracker.sure and not self.tracker.doubt.stands:
            self._use(calibration)
            self.under_way = None
            self.tracker.rescaled(self._belief.model)
            self._slope_learnt = self.tracker.law is not None
            self._life.on(Event.RESTORED)
        else:
            self.restore(PriorKnowledge(calibration, None), calibration, self.tracker.thermometer.reading)
        self.scratch = ()
        self._life.say(reason)

    @property
    def seen(self) -> tuple[Floats, Floats] | None:
        """Bias (3,) in rad/s measured in rests of this boot, and its standard deviation (3,) in rad/s, sensor frame.

        None while a standard deviation is above the limit `TrackKnobs.bias_std`, rad/s.
        """
        return (self.tracker.bias, self.tracker.std) if self.tracker.sure else None

    @property
    def noise_std(self) -> Floats:
        """White noise of one reading: standard deviation (3,), rad/s.

        As measured in rests; before a rest, that of the device model.
        """
        return reading_std(self._stillness.noise_std) if self._stillness.noise_known else self._belief.model.noise_std

    def resume(self, remembered: PriorKnowledge, temperature_c: float | None) -> bool:
        """Restore the stored bias of a boot that has no calibration; True if the bias was restored.

        False if no bias is stored, or a calibration is in use. remembered: prior knowledge that contains the stored
        bias. temperature_c: the device's temperature now, °C, or None.
        """
        kept = remembered.bias_at(self.now, self._knobs.track.bias_std)
        if kept is None or self.calibration is not None:
            return False
        self.tracker.restored(self._belief.model, kept, self.now, temperature_c)
        if remembered.doubted:
            self.tracker.doubt.why = _WAS_DOUBTED
        return True

    def believe(self, calibration: Calibration) -> None:
        """Use the scale factors of an earlier boot's calibration as a prior until this boot is calibrated.

        calibration: that calibration. A bias measured in rests of this boot is kept.
        """
        self._use(None, calibration)
        if self.tracker.sure:
            self.tracker.rescaled(self._belief.model)
        else:
            self.tracker.supposed(self._belief.model, self._belief.bias_std, self.now)

    def moves(self, moves: float) -> bool:
        """Set how much the scale factors change from boot to boot; return whether the gyro model in use changed.

        moves: relative standard deviation of this change, without unit.
        """
        self._moves = moves
        if self.prior is None:
            return False
        self._use(None, self.prior)
        self.tracker.rescaled(self._belief.model)
        return True

    def expect(self, law: TemperatureLaw) -> None:
        """Set the temperature law (bias against temperature) if it becomes available only during the boot.

        A slope that was estimated under a law is kept. Any other slope is replaced by the law's.
        """
        self.tracker.expect(law, learnt=self.calibration is not None and self._slope_learnt)
        self._slope_learnt = self.calibration is not None

    def _say_beside(self, news: Sentences, outcome: Outcome) -> None:
        """Report news while a calibration is in progress: the device's own reason stays the next step for the operator."""
        outcome.changed = True
        outcome.said.append(english(*news))

    def _progress(self, progress: Progress, under_way: CalibrationProgress, outcome: Outcome, now_ns: int) -> None:
        """Handle a step of a calibration in progress; now_ns: host time of the window's last sample."""
        match progress:
            case RestFound():
                self._happens(Event.RESTED, (Code.TURN_NOW(axes=axis_names(under_way.missing())),), outcome)
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
        self._use(made)
        self.under_way, self.scratch = None, ()
        self.tracker.calibrated(self._belief.model, result.covariance[:3, :3], result.bias_time, _bias_in(rest))
        self._slope_learnt = self.tracker.law is not None
        self._happens(Event.CALIBRATED, (Code.CALIBRATED(), *result.reason), outcome)

    def _learnt_worn(self, outcome: Outcome, now_ns: int) -> None:
        """Use the matrix estimated from gravity while the device is worn; turns in progress continue."""
        before = self.calibration
        if before is not None and before.method != METHOD:
            self._by_hand = before
        made = self._as_message(learnt(self.tracker, self.noise_std, before.turns if before else ()), "", now_ns)
        outcome.calibrations.append(made)
        self._use(made)
        self.tracker.corrected_by(self._belief.model)
        self._say_beside(made.reason, outcome)

    def _give_up_worn(self) -> None:
        """Return to the calibration by hand after a doubt of the bias: the matrix estimated since may be the cause."""
        if self._by_hand is not None and self.calibration is not None and self.calibration.method == METHOD:
            self._use(self._by_hand)
            self._by_hand = None
            self.tracker.rescaled(self._belief.model)

    def cancel(self, who: str) -> None:
        """Cancel the calibration in progress for the person `who`, who is named in the status.

        An older calibration of this boot stays in use. Without one, the calibration starts over.
        """
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

    @property
    def awaited(self) -> bool:
        """True while a person waits for a calibration's first rest or, from its first turn on, for its outcome."""
        return self.under_way is not None and self.under_way.awaited

    @property
    def asked(self) -> tuple[str, str] | None:
        """Name of the person who requested the recalibration in progress, and the reason given.

        None if nobody requested one.
        """
        return None if self.under_way is None else self.under_way.asked

    @property
    def turned(self) -> tuple[int, ...]:
        """Axes (0, 1, 2 for x, y, z) whose turns are accepted in the calibration in progress.

        Empty if none is in progress.
        """
        return () if self.under_way is None else self.under_way.done()

    @property
    def progress(self) -> float:
        """Progress of the calibration, 0 to 1: 0.1 for a known bias, 0.3 for each turn.

        1 when no calibration is in progress.
        """
        return 1.0 if self.under_way is None else min(0.1 * self.tracker.sure + 0.3 * len(self.turned), 1.0)

    def bias(self) -> BiasState | None:
        """Return the bias state to store for a restart; None while the boot is uncalibrated and its bias uncertain."""
        return self.tracker.worth_keeping if self.calibration is not None or self.tracker.sure else None


def _bias_in(rest: Rest) -> RestBias:
    return RestBias(rest.bias, rest.bias_cov, rest.rounding_var, rest.middle, rest.end)
