"""Session of one device: takes raw samples; gives corrected rates, calibrations and a status.

Pure: no clock, bus or store. Time is device time, from the samples; knowledge of earlier boots is passed in.
"""

from collections.abc import Iterable

import numpy as np

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code, Sentence, Sentences
from bridge.wire.messages import (
    NO_REST_S,
    Alert,
    Calibration,
    DeviceCalibration,
    Placement,
    Quality,
    State,
    Status,
    Verdict,
)
from estimator.device.boot_estimation import BootEstimationState
from estimator.device.calibration_progress import CalibrationProgress
from estimator.device.corrected_stream import CorrectedStream, as_message
from estimator.device.correction import Correction
from estimator.device.lifecycle import Event
from estimator.device.outcome import Outcome
from estimator.device.own_calibration import METHOD, judged
from estimator.device.prior_knowledge import PriorKnowledge
from estimator.device.sequence_numbers import SequenceNumbers
from estimator.device.session_knobs import SessionKnobs
from estimator.geometry.gyro_model import Floats, axis_names
from estimator.orientation.attitude import Attitude
from estimator.samples.blocks import BLOCK_S, SHORT_S, Blocks
from estimator.samples.sample_buffer import TIME
from estimator.state import StateStruct, decode, encode
from estimator.stillness.detector import too_seldom
from estimator.tracking.bias_state import BiasState
from estimator.tracking.temperature_law import TemperatureLaw

#: version of the bytes from `state`; any other version is refused
VERSION = 4
#: event name for turns of a calibration lost when another estimator took the device over
TURNS_LOST = "turns lost with an estimator"
#: event name for calibrations of the device's own that were not plausible
OWN_REFUSED = "own calibration refused"


class SessionState(StateStruct):
    """Saved state of a device session, up to sample number `next`, the first sample that no estimate has used.

    version: of this format. first: number of the boot's first sample. last_heard_ns: host time of the last receipt, ns
    since the Unix epoch.
    begun_s: device time of sample `next`, s; None when unknown. length_s: length of its block, s. latest_s: device time
    of the sample before it, s.
    clock: two values. The first is the device time of the boot's first sample, s, or None. The second is device time
    minus the device's own clock, s; it is 0 unless that clock went back.
    applied: correction of the block with sample `next`. ready: correction of the next block, unless a later estimate
    replaces it.
    life: names of the lifecycle state and of the state before the device went away, and the reasons of both. learnt:
    state of calibration and bias filter.
    attitude: orientation state after all samples corrected so far, and what set its heading to zero; None without one.
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
    attitude: tuple[Floats, str] | None = None


class DeviceSession(CorrectedStream):
    """Session of one device across its boots: takes raw samples; gives corrected rates, calibrations and a status.

    device: its id. knobs: settings of the session. began: device time of the first boot's start, s.
    sequence: sequence counters to continue; new ones by default.
    """

    # ---- boots ----------------------------------------------------------------------------------------------------

    def begin_boot(
        self,
        boot: int,
        device_time: float,
        remembered: PriorKnowledge | None,
        law: TemperatureLaw | None = None,
        temperature_c: float | None = None,
    ) -> Outcome:
        """Begin a boot: drop the calibration of the previous boot, then restore what is stored of this one.

        boot: its id. device_time: device time of the boot's start, s. temperature_c: the device's temperature now, °C,
        or None.
        remembered: stored calibration and bias, or None. law: temperature law (bias against temperature) from earlier
        boots, or None.
        Returns the outcome, which includes the last block of the previous boot.
        """
        outcome = self.learn()  # the last block of the previous boot
        first, again = self.boot is None, boot == self.boot and self.sequence.next is None
        self.sequence.begin(boot)
        if not self._unused or device_time != self.learnt.began or law is not None:
            self._begin(device_time, law)
        self._unused = False
        if self.attitude is not None:
            self.orient()
        why = Code.WARMING_UP() if first else Code.RESTARTED()
        self.life.on(Event.BOOTED, () if again else (why,))  # again: no sample of this boot was taken yet
        outcome.changed = True
        outcome.said.append(f"boot {boot:016x}" + ("" if first else ", recalibration needed"))
        calibration = None if remembered is None else remembered.calibration
        if remembered is not None and calibration is not None and calibration.boot == boot:
            self._restore(remembered, calibration, temperature_c)
            outcome.said.append(f"calibration {calibration.id} of this boot was restored")
        elif calibration is not None:
            self.believe(calibration)
        if remembered is not None and self.learnt.resume(remembered, temperature_c):
            self._apply()
            outcome.said.append("the bias of this boot was restored")
        return outcome

    def _lost_turns(self, axes: tuple[int, ...], outcome: Outcome) -> None:
        if self.learnt.under_way is None:
            return
        lost = Code.TURNS_LOST(axes=axis_names(axes))
        self.learnt.scratch = (lost,)
        self.sequence.events.add(TURNS_LOST, len(axes))
        outcome.said.append(english(lost))

    def start_over(self, why: Sentences) -> Outcome:
        """Discard calibration and bias because the device has changed; its sample stream continues.

        why: reason, part of the status until the next calibration.
        """
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
        """Use the scale factors of an earlier boot's calibration as a prior until this boot is calibrated.

        Does nothing if this boot is calibrated already.
        """
        if self.calibration is None:
            self.learnt.believe(calibration)
            self._apply()

    def moves(self, moves: float) -> None:
        """Set how much the scale factors change from boot to boot, computed from earlier boots.

        moves: relative standard deviation of this change, without unit.
        """
        if self.learnt.moves(moves):
            self._apply()

    def adopt(self, remembered: PriorKnowledge, calibration: Calibration) -> None:
        """Adopt a calibration that another estimator made in this same boot; a calibration in progress ends.

        remembered: the stored bias that belongs to the calibration.
        """
        self._restore(remembered, calibration, self.tracker.thermometer.reading)
        self.learnt.scratch = ()

    def offered(self, own: DeviceCalibration, now_ns: int) -> Outcome:
        """Check a calibration that the device made itself, and use it if it is plausible.

        It is ignored if this estimator made a calibration in this boot. It waits while the device is away, and while a
        requested calibration or one with accepted turns is in progress.
        now_ns: host time, ns since the Unix epoch. The outcome is empty if the calibration is not checked.
        """
        learnt, known = self.learnt, self.calibration
        if own == self._offered or self.life.away or learnt.turned or learnt.asked:
            return Outcome()
        if known is not None and (known.method != METHOD or _same(own, known)):
            return Outcome()
        self._offered = own
        result = judged(own, self.boot or 0, learnt.seen, learnt.noise_std)
        made = as_message(self, result, "", now_ns)
        if result.verdict is Verdict.ACCEPTED:
            learnt.accept(made, (Code.CALIBRATED(), *result.reason))
            self._apply()
        else:
            self.count_event(OWN_REFUSED)
        return Outcome(calibrations=[made], changed=True, said=[english(*result.reason)])

    # ---- saving and restoring -------------------------------------------------------------------------------------

    def state(self) -> bytes | None:
        """Serialise the session to bytes for `restored`; None before the first sample of a boot.

        The restored session needs the samples from `sequence.next` on, and then continues bit for bit. The turns of a
        calibration in progress are not saved.
        """
        buffer, next_ = self._blocks.buffer, self.sequence.next
        if self.boot is None or next_ is None:
            return None
        if self._lesson is None:
            end, applied, length_s = buffer.end, self.applied, self._blocks.length_s
            begun_s, next_ = self._blocks.begun or (None, next_)
        else:  # the block not learnt from yet lies before the current one
            end, applied, length_s = self._lesson[0], self._lesson_applied, self._lesson_s
            begun_s, next_ = buffer.rows(end, end + 1).item(0, TIME), buffer.place(end)[0]
        clock = self._blocks.clock if end else (None, 0.0)  # no sample before the block
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
                None if self.attitude is None else (self.attitude.state, self.attitude.zero),
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
        """Restore a session from the bytes of `state`, with the calibration that belongs to them.

        Pass the restored session all samples from number `sequence.next` on, even samples corrected before. The turns
        of a calibration in progress must be repeated, which the status says.
        Raises ValueError if the state is damaged, or belongs to another device, version or calibration.
        """
        saved = decode(state, SessionState)
        if (saved.version, saved.device) != (VERSION, device):
            raise ValueError(
                f"the saved state is of {saved.device!r}, version {saved.version}; {device!r}, version {VERSION}, is expected"
            )
        if saved.length_s not in (BLOCK_S, SHORT_S):
            raise ValueError(f"damaged state: blocks of {saved.length_s} s do not exist; start without this state")
        session = cls(device, knobs, saved.learnt.began, sequence)
        buffer = session.learnt.go_on(saved.learnt, calibration, saved.boot)
        for correction in (saved.applied, saved.ready):
            correction.check()
            if correction.quality is Quality.GOOD and session.calibration is None:
                raise ValueError(
                    "damaged state: quality GOOD needs a calibration of this boot; start without this state"
                )
        session.life.resume(saved.life)
        session._blocks = Blocks(saved.latest_s)
        session._blocks.length_s = saved.length_s
        session._blocks.resume(buffer, saved.clock, saved.begun_s)
        session.applied, session._ready = saved.applied, saved.ready
        if saved.attitude is not None:
            session.attitude = Attitude(*saved.attitude)
        session.sequence.resume(saved.boot, saved.first, saved.next)
        session.last_heard_ns, session._unused = saved.last_heard_ns, False
        if saved.learnt.under_way:
            session.life.on(Event.CANCEL_TO_START, (Code.HOLD_STILL(),))
        if saved.learnt.turned:
            session._lost_turns(saved.learnt.turned, Outcome())
        return session

    # ---- requests and silence -------------------------------------------------------------------------------------

    def recalibrate(self, who: str, reason: str) -> Sentence | None:
        """Request a recalibration (three new turns) for person `who`; the present calibration stays in use until then.

        reason: the person's own words, may be empty. Returns None, or a sentence that says why the request is refused.
        """
        if not self.life.on(Event.RECALIBRATE):
            code = Code.ALREADY_DUE if self.life.state is State.WARMING else Code.NOT_HEARD
            return code(device=self.device)
        self.learnt.under_way = CalibrationProgress(self.knobs, who, reason)
        why = (Code.REQUEST_REASON(words=reason),) if reason else ()
        self.life.say((Code.RECALIBRATION_ASKED(who=who), *why, Code.HOLD_STILL()))
        return None

    def cancel(self, who: str) -> Sentence | None:
        """Cancel the calibration in progress for person `who`; an older calibration stays in use.

        Returns None, or a sentence that says why the request is refused.
        """
        event = Event.CANCEL_TO_START if self.calibration is None else Event.CANCEL_TO_TRACKING
        if not self.life.on(event):
            return Code.NOTHING_TO_CANCEL(device=self.device)
        if self.tracker.doubt.stands:
            self.life.on(Event.DOUBTED)
        self.learnt.cancel(who)
        return None

    def zero_heading(self, who: str) -> Sentence | None:
        """Set the device's present heading to zero for person `who`.

        Returns None, or a sentence that says why the request is refused.
        """
        if self.attitude is None or not self.attitude.begun:
            return Code.NO_ORIENTATION(device=self.device)
        self.attitude.reset_heading(who)
        return None

    def silence(self, reason: Sentences, event: Event = Event.SILENT) -> bool:
        """Mark the device as away, by an event of the lifecycle and its reason; return whether the state changed.

        False if the device was away already; then at most the reason changes.
        """
        if not self.life.on(event, reason):
            unknown = (Event.OUTDATED, Event.UNREACHABLE) if self.life.state is State.UNKNOWN else ()
            if event in unknown or (self.life.state, event) == (State.LOST, Event.SILENT):
                self.life.reason = reason
            return False
        self._blocks.own()
        self._apply()
        return True

    # ---- status ---------------------------------------------------------------------------------------------------

    def status(
        self,
        time_ns: int,
        *,
        bridge: str = "",
        refused_bridges: tuple[str, ...] = (),
        epoch: int = 0,
        silent_s: float = 0.0,
        more: Iterable[tuple[str, int]] = (),
        placement: Placement | None = None,
        alerts: tuple[Alert, ...] = (),
    ) -> Status:
        """Build the status message of the device: state, reason, quality, estimates, counters and new receipts.

        time_ns: time of the status, ns since the Unix epoch. silent_s: seconds since the last sample.
        bridge: id of the bridge whose samples are used. refused_bridges: ids of bridges whose samples are refused.
        epoch: number of this estimator's ownership; rises with each takeover. more: events counted outside the session.
        placement: where and by whom the device is worn. alerts: alerts of the device that have not ended.
        Each receipt (record of one measurement update of the bias filter) appears in one status only.
        """
        known, learnt = self._ready, self.learnt
        seldom = self._too_seldom() if self.life.state is State.AWAITING_STILL else ()
        reason = seldom or self.life.reason
        if not self.life.away:  # a doubted bias is mentioned beside any other reason
            reason += tuple(one for one in self.tracker.doubt.why if one not in reason)
        events = self.sequence.events.as_dict() | self.tracker.events
        events.update(more)
        receipts = tuple(learnt.receipts)
        learnt.receipts.clear()
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
            placement=placement,
            alerts=alerts,
            epoch=epoch,
            accelerometer=learnt.accelerometer,
            nis=float(np.nan_to_num(self.tracker.doubt.consistency.mean_nis)),
            receipts=receipts,
        )

    def checkpoint(self) -> BiasState | None:
        """Return the bias state to store for a restart.

        None without samples, or while the boot is uncalibrated and its bias uncertain.
        """
        return None if self.sequence.next is None else self.learnt.bias()

    def _too_seldom(self) -> Sentences:
        told = self.info
        rate_hz = max(told.rate_hz, told.measured_rate_hz) if told is not None else 0.0
        return too_seldom(rate_hz)

    def _rate(self) -> float:
        seconds = self._blocks.seconds
        return (self.sequence.seen - 1) / seconds if seconds > 0 else 0.0


def _same(own: DeviceCalibration, known: Calibration) -> bool:
    """Return whether a calibration in use has these values."""
    return np.array_equal(own.scale, known.matrix.diagonal()) and np.array_equal(own.bias, known.bias)
