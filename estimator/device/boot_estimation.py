"""Estimation within one boot: updates calibration and bias from blocks of samples; gives the correction."""

from collections import deque

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code, Sentences
from bridge.wire import messages
from bridge.wire.message_parts import MAX_RECEIPTS
from bridge.wire.messages import AccelerometerCalibration, Calibration, State, Verdict
from bridge.wire.refusal import Tally
from estimator.calibration.accelerometer import in_use
from estimator.device.boot_calibration import AsMessage, BootCalibration
from estimator.device.calibration_progress import CalibrationProgress
from estimator.device.correction import Correction, choose
from estimator.device.lifecycle import Event, Lifecycle
from estimator.device.outcome import Outcome
from estimator.device.receipts import receipt_message
from estimator.device.resting_poses import PosesState, RestingPoses
from estimator.device.revision_sequences import RevisionSequences
from estimator.device.saved_samples import SavedSamples
from estimator.device.session_knobs import SessionKnobs
from estimator.geometry.gyro_model import reading_std
from estimator.samples.sample_buffer import SampleBuffer
from estimator.state import StateStruct
from estimator.stillness.detector import StillnessState, Windows
from estimator.tracking.evidence import Receipt
from estimator.tracking.seconds import Second
from estimator.tracking.temperature_law import TemperatureLaw
from estimator.tracking.tracked_bias import TrackerState


class BootEstimationState(StateStruct):
    """Saved state of a boot's estimation.

    Not saved: the samples of a calibration in progress, and the history kept for smoothing.

    calibration: id of the calibration in use, which is stored elsewhere; empty without one.
    under_way: whether a calibration is in progress. asked: the person who requested it, and the reason.
    turned: axes (0, 1, 2) whose turns are accepted. scratch: reasons why earlier knowledge does not apply.
    began, now: device time, s, of the boot's start, and of the end of the last window judged still or moving.
    silent_until, silent_c: device time, s, and temperature, °C, of the first sample after the latest silence.
    moves: relative standard deviation of the change of the scale factors from boot to boot, without unit.
    cancelled, cancelled_until: reasons shown after a cancelled calibration, until this device time, s.
    slope_learnt: whether the bias slope against temperature was estimated under a temperature law.
    reached: sequence number and host time, ns since the Unix epoch, of the last sample used for the bias.
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
    poses: PosesState


class BootEstimation(BootCalibration):
    """Estimation within one boot: calibration, bias tracking and the correction to apply.

    began: device time of the boot's start, s. law: temperature law (bias against temperature) from earlier boots, or
    None.
    life: state table that receives the events. events: counts of other events.
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
        super().__init__(knobs, began, law, life, events, as_message)
        self._silent_until = float("-inf")  # device time of the first sample after the latest silence, s
        self._silent_c: float | None = None  # the temperature then, °C
        self._past = RevisionSequences()
        self._poses = RestingPoses()
        #: the filter's latest receipts, until a status tells them
        self.receipts = deque[messages.Receipt](maxlen=MAX_RECEIPTS)

    def saved(self, buffer: SampleBuffer, end: int) -> BootEstimationState:
        """Return the state to save for `go_on`.

        buffer: holds the samples; the estimation has used those below number `end`.
        Encode the state at once, because its parts are shared with the running estimation.
        """
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
            self._poses.state,
        )

    def go_on(self, saved: BootEstimationState, calibration: Calibration | None, boot: int) -> SampleBuffer:
        """Restore a saved state at the start of a boot; returns the buffer with the samples so far.

        calibration: the calibration whose id is in the state, or None. boot: id of the present boot.
        Raises ValueError if the state is damaged or names another calibration.
        """
        if saved.calibration != ("" if calibration is None else calibration.id):
            raise ValueError(
                f"the saved state needs calibration {saved.calibration or '(none)'}: give this calibration"
            )
        own = calibration is not None and calibration.boot == boot
        self._moves = saved.moves
        self._use(calibration if own else None, None if own else calibration)
        who, why = saved.asked or ("", "")
        self.under_way = CalibrationProgress(self._knobs, who, why) if saved.under_way else None
        buffer = saved.taken.buffer()
        self._stillness.resume(saved.stillness)
        first, end = saved.taken.first, saved.stillness.next
        if not first <= end <= buffer.end:
            raise ValueError("damaged state: samples are missing; start without this state")
        self.tracker.go_on(saved.tracker, self._belief.model, first, buffer.rows(first, end))
        self.began, self.now, self.scratch = saved.began, saved.now, saved.scratch
        self._silent_until, self._silent_c = saved.silent_until, saved.silent_c
        self._cancelled, self._cancelled_until = saved.cancelled, saved.cancelled_until
        self._slope_learnt = saved.slope_learnt
        self._poses.restore(saved.poses)
        if saved.reached is not None:
            self._past.note(self.tracker.time, *saved.reached)
        return buffer

    def resumed(self, time: float, celsius: float | None) -> None:
        """Record the end of a period without samples: device time and temperature of the first sample after it.

        time: device time, s. celsius: temperature, °C, or None. Until the tracker reaches `time`, `correction` uses
        the bias predicted for `time`.
        """
        self._silent_until, self._silent_c = time, celsius

    # ---- samples --------------------------------------------------------------------------------------------------

    def learn(self, buffer: SampleBuffer, end: int, of: tuple[str, int], outcome: Outcome) -> bool:
        """Update bias and calibration from the samples numbered below `end`; return whether the correction has changed.

        buffer: holds the samples. of: device id and boot id. outcome: receives results and events.
        """
        begin, belief = self.tracker.time, self._belief
        windows = self._stillness.take(buffer, end)
        windows = windows.part(self._warm_up(windows, buffer, outcome))
        if self.under_way is not None and len(windows):
            self.under_way.take(windows.samples[1])
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
                self.under_way.take(window.samples[1])
            self.tracker.seconds.skip(window)
            buffer.forget(last)
            warm = now - self.began >= self._knobs.warming_s or self.began > self._knobs.warming_s
            if warm and self._happens(Event.WARM, (Code.HOLD_STILL(),), outcome):
                return i + 1
        return len(heads)

    def _second(self, second: Second, buffer: SampleBuffer, of: tuple[str, int], outcome: Outcome) -> None:
        """Track the bias over a second, and revise the bias of a gap in the evidence that it ends."""
        refuted, receipts = self.tracker.law_refuted, self.tracker.learn(second)
        if self.tracker.law_refuted and not refuted:
            self._events.add("temperature law disagrees")
            outcome.said.append(english(Code.TEMPERATURE_LAW_REFUTED()))
        self._heard(receipts, outcome)
        self._poses.take(second)
        sequence, time_ns = buffer.place(second.last)
        self.receipts += [receipt_message(one, time_ns - round((second.end - one.time) * 1e9)) for one in receipts]
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
        if why := self.tracker.doubts(self.now):
            self._give_up_worn()
            if not self._happens(Event.DOUBTED, why, outcome):
                self._say_beside(why, outcome)

    def _confirm(self, outcome: Outcome) -> None:
        """End a doubt of the bias when the latest rests have resolved it."""
        if self.tracker.trusts() and not self._happens(
            Event.CONFIRMED, (Code.CALIBRATED(), Code.BIAS_CONFIRMED()), outcome
        ):
            self._say_beside((Code.BIAS_CONFIRMED(),), outcome)

    @property
    def _doubted(self) -> bool:
        """True if a rest can confirm a doubted bias."""
        return self.tracker.doubt.stands or self._life.state is State.DEGRADED

    # ---- estimates -------------------------------------------------------------------------------------------------

    @property
    def reached(self) -> tuple[int, int] | None:
        """Sequence number and host time, ns since the Unix epoch, of the last sample used for the bias.

        None before the first.
        """
        return self._past.reached

    @property
    def accelerometer(self) -> AccelerometerCalibration | None:
        """Accelerometer calibration from this boot's rests if accepted, else the one of the calibration in use.

        If none is accepted: the latest one from this boot's rests, or None.
        """
        own, given = self._poses.found, None if self.calibration is None else self.calibration.accelerometer
        accepted = [one for one in (own, given) if one is not None and one.verdict is Verdict.ACCEPTED]
        return accepted[0] if accepted else own

    def correction(self) -> Correction:
        """Return the correction for samples from now on: from calibration, tracked bias and measured noise."""
        noise_std = reading_std(self._stillness.noise_std) if self._stillness.noise_known else None
        track = self.tracker
        bias, std = track.ahead(self._silent_until, self._silent_c)
        sure = track.sure and not track.doubt.stands and all(axis < self._knobs.track.bias_std for axis in std.tolist())
        knobs, known = self._knobs.track.bias, self.accelerometer
        return choose(
            self._belief,
            bias,
            std,
            noise_std,
            knobs.flicker,
            sure=sure,
            away=self._life.away,
            walk=knobs.rate_random_walk,
            taught=track.taught,
            accel=None if known is None or known.verdict is not Verdict.ACCEPTED else in_use(known),
        )
