"""Calibration and correction of recordings, with the same detection, methods and session as in the live service."""

from collections.abc import Callable
from dataclasses import replace
from math import isclose

import numpy as np

from bridge.reasons.catalogue import english
from bridge.recording import Recording, RecordingError
from bridge.terminal.plurals import count
from bridge.wire import keys
from bridge.wire.batches import TOLD
from bridge.wire.messages import Calibration, CorrectedBatch, SampleBatch, Verdict
from estimator.calibration.capture import Samples
from estimator.calibration.clipping import at_range
from estimator.calibration.method_names import DEFAULT
from estimator.calibration.methods import BY_MOVEMENTS, BY_RATES
from estimator.calibration.result import Result
from estimator.calibration.session import CalibrationSession
from estimator.calibration.session_events import Finished, Ignored, TurnFound
from estimator.config.device_settings import knobs_of_stated
from estimator.device import batch_correction
from estimator.device.batch_correction import Cut, batch_of
from estimator.device.orientation import oriented
from estimator.device.outcome import Outcome
from estimator.device.prior_knowledge import PriorKnowledge
from estimator.device.resting_poses import RestingPoses
from estimator.device.same_rate import same_rate
from estimator.device.session import DeviceSession
from estimator.device.session_knobs import SessionKnobs
from estimator.device.worn_calibration import METHOD as WORN
from estimator.offline import smoothing
from estimator.offline.calibration_file import of_result
from estimator.offline.corrected_recording import CorrectedRecording, Rows
from estimator.offline.recorded_batches import BOOT, batches, flags_of, info_of
from estimator.samples import sample_buffer
from estimator.samples.sample_buffer import UNFIT
from estimator.stillness.detector import Stillness, Windows
from estimator.tracking.seconds import Seconds

#: length of the batches given to a session; a rest and its surroundings must fit into the session's memory
BATCH_S = 1.0
#: logged when the first rest counts from the recording's start; live, a device just switched on would have to warm up
_ON_BEFORE = (
    "the device is assumed to have been on before the recording began: after a power-up, the first {:g} s would not count, "
    "and a turn would be lost"
)
_AT_THE_END = (
    "the calibration was found at the end of the recording and corrects no row; --smooth corrects all rows with it"
)
_UNTAUGHT = "gravity gave no scale or misalignment more certain than the known values: the device moved too little"
_NO_ACCEL = "gravity gave no scale or misalignment: the recording has no accelerometer"


def calibrate(
    recording: Recording,
    method: str = DEFAULT,
    gyro_range: float = 0.0,
    rates: tuple[float, ...] = (),
    knobs: SessionKnobs | None = None,
) -> tuple[Result, list[str]]:
    """Calibrate a gyro from a recording: returns the result, and the reasons why movements were not used.

    method: `closure` (default) or `turn360`, from three full turns by hand; `transitions` or `accel_aided`, from any
    movements between rests; `turntable` or `servomotor`, from turns at known rates. See docs/method.md.
    gyro_range: full-scale range, rad/s; 0 when unknown. Readings at 99 % of it count as clipped.
    rates: known rates of the machine, rad/s, for `turntable` and `servomotor`.
    knobs: settings of the device's kind, by default of an unknown device; the calibration method in `knobs` is ignored.

    The result is the first accepted calibration, otherwise the last attempt. `transitions`, `accel_aided`, `turntable`
    and `servomotor` use the entire recording at once. The accelerometer is calibrated from all rests of the recording.
    """
    knobs = knobs or SessionKnobs()
    samples = Samples(recording.time_s, recording.gyro, recording.accel, flags_of(recording, gyro_range) & UNFIT != 0)
    windows = Stillness(knobs.prior.noise_std).feed(samples.time, samples.gyro, samples.accel, samples.clipped)
    result, passed_over = _calibrated(samples, windows, method, gyro_range, rates, knobs)
    poses = RestingPoses()
    for _, second in Seconds().take(windows):
        poses.take(second)
    poses.end_rest()
    return replace(result, accelerometer=poses.found), passed_over


def _calibrated(
    samples: Samples, windows: Windows, method: str, gyro_range: float, rates: tuple[float, ...], knobs: SessionKnobs
) -> tuple[Result, list[str]]:
    gyro_range = gyro_range or knobs.gyro_range
    if method in BY_RATES:
        samples = replace(samples, clipped=at_range(samples, gyro_range))
        return BY_RATES[method](samples, rates, knobs.wander), []
    session = CalibrationSession(
        method,
        gyro_range=gyro_range,
        horizontal=knobs.horizontal_turns,
        scale_limit=knobs.scale_limit,
        whole=method in BY_MOVEMENTS,
    )
    if len(windows):
        session.take(windows.samples[1])
    passed_over: list[str] = []
    last: Result | None = None
    for begun, ended, _, still in windows.heads:
        for progress in session.judge(begun, ended, still=still):
            if isinstance(progress, Ignored):
                passed_over.append(f"{ended:.1f} s: {english(*progress.no_turn.reason)}")
            elif isinstance(progress, TurnFound):
                passed_over += [f"{ended:.1f} s: {english(why)}" for why in progress.dropped.values()]
            elif isinstance(progress, Finished):
                last = progress.result
                if not last.repeat:
                    return last, passed_over
    return last or session.unfinished(), passed_over


def correct(
    recording: Recording,
    calibration: Calibration | Result | None = None,
    knobs: SessionKnobs | None = None,
    *,
    smooth: bool = False,
    other_boot: bool = False,
    gyro_range: float = 0.0,
    warmed_up: bool = False,
    batch: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> CorrectedRecording:
    """Correct a recording as the live service would; returns corrected rates (n, 3), rad/s, in the sensor frame, and more.

    Each row is corrected with what was known at the time of its sample, unless `smooth` is set.
    calibration: calibration to correct with. If it is from the recording's boot, the standard deviation of its bias is
    enlarged until a rest in the recording confirms the bias. It counts as from another boot if `other_boot` is set, or
    if its boot, range or rate differs from the recording's. Then its scale factors are a prior, and its bias is not
    used.
    knobs: settings of the device; by default those of the model that the device states, as in a ward.
    smooth: use the whole recording for every row.
    gyro_range: full-scale range, rad/s; 0 when unknown.
    warmed_up: the device was on and worn for 15 minutes before the recording began. Otherwise its bias may drift while
    it warms up, unless the recorded temperature shows this drift.
    batch: number of samples processed at a time; does not affect the result. progress(done, n): called after each
    batch.

    Without `calibration`, the first of these that exists is used:

    - the last calibration in `Recording.made` from before the recording;
    - the calibration from the first three full turns in the recording. In earlier rows only
      the estimated bias is subtracted;
    - the first calibration in `Recording.made`.

    If there is none, only the bias is subtracted in all rows. `CorrectedRecording.quality` tells for each row what was known.

    The live service ignores readings within `knobs.warming_s` seconds after a boot. A recording without
    `Recording.told` does not show when the boot was. If its turns give no calibration, it is corrected a second time
    without ignoring the first seconds.

    Raises RecordingError if a reading is beyond the range, if there is nothing to smooth, or if the calibration belongs
    to another device.
    """
    knobs = knobs or knobs_of_stated(recording.model)
    if warmed_up:
        cool = replace(knobs.track.bias, warm_up_walk=0.0)
        knobs = replace(knobs, track=replace(knobs.track, bias=cool))
    if smooth:
        knobs = smoothing.remembering(knobs)
    size = batch or max(1, round(BATCH_S * recording.rate_hz))

    def passed(known: Calibration | None, said: str = "", knobs: SessionKnobs = knobs) -> _Pass:
        pass_ = _Pass(recording, knobs, known, said, gyro_range=gyro_range, smooth=smooth, other_boot=other_boot)
        for one in batches(recording, gyro_range, size):
            pass_.take(one)
            if progress is not None:
                progress(pass_.rows.filled, len(recording))
        pass_.over()
        return pass_

    if calibration is not None:
        return passed(_usable(calibration, recording)).corrected()
    if before := [one for one in recording.made if one.time_ns <= recording.begin_ns]:
        later = len(recording.made) - len(before)
        used = _used(before[-1]) + (f"; not used: {count(later, 'later calibration')}" if later else "")
        return passed(before[-1], used).corrected()
    found = passed(None)
    if found.calibrated:
        return found.corrected()
    if recording.made:
        # Made during the recording, but not all of its turns are in it.
        found = passed(recording.made[0], _used(recording.made[0], " without all of its turns"))
    elif found.turned and recording.told is None:
        again = passed(None, _ON_BEFORE.format(knobs.warming_s), replace(knobs, warming_s=0.0))
        found = again if again.calibrated else found
    return found.corrected()


def _used(one: Calibration, how: str = "") -> str:
    return f"calibration {one.id} of this boot, which the recording holds{how}, is used"


class _Pass:
    """One pass through a recording, fed to a device session as the live service does."""

    def __init__(
        self,
        recording: Recording,
        knobs: SessionKnobs,
        known: Calibration | None,
        own: str,
        *,
        gyro_range: float,
        smooth: bool,
        other_boot: bool,
    ) -> None:
        """own: message about a calibration of the recording's own boot; empty for any other calibration."""
        self.rows = Rows(len(recording))
        self._recording = recording
        self._session = DeviceSession("recorded", knobs)
        self._session.info = info_of(recording)
        self._smooth = smooth
        self._said: list[str] = [own] if own else []
        #: matrix and name of each calibration, by id
        self._known = {"": (np.eye(3), "")}
        self._last: CorrectedBatch | None = None
        #: whether gravity is to teach the matrix, and has not done so yet
        self._untaught = knobs.track.learn_matrix
        #: whether any turn was recognised
        self.turned = False
        remembered = None
        if known is not None:
            other_boot = other_boot and not own
            if (
                not own
                and not other_boot
                and (why := _foreign(known, recording, gyro_range or recording.gyro_range)) is not None
            ):
                self._said.append(f"{why}: the scale is used as one of another boot, the bias is not used")
                other_boot = True
            remembered = PriorKnowledge(replace(known, boot=BOOT + other_boot), None)
            self._known[known.id] = known.matrix, known.id
        self._session.orient()
        self._session.begin_boot(BOOT, float(recording.device_time[0]), remembered)

    def take(self, batch: SampleBatch) -> None:
        """Correct a batch, fill its rows, and learn from it at once."""
        session, cuts = self._session, list[Cut]()
        if (outcome := session.take(sample_buffer.Samples.of(batch), cuts)) is not None:
            self._note(outcome)
        for cut, rates in zip(cuts, batch_correction.correct(cuts), strict=True):
            self._last = batch_of(cut, rates)
            self.rows.take(self._last, self._known[cut.correction.calibration][0])
        if session.attitude is not None:
            for one in oriented([(session.attitude, cut) for cut in cuts], every=True):
                self.rows.turn(one.attitudes)
        self._note(session.learn())

    def over(self) -> None:
        """End the session and note its last results."""
        self._note(self._session.end())
        made, last = self._session.calibration, self._last
        if made is None or last is None or last.calibration == made.id:
            return
        # The last block brought this calibration; a block's knowledge is used from the end of the next block on.
        if self._smooth:
            known = self._session.learnt.correction()
            self._last = replace(last, calibration=known.calibration, **dict(zip(TOLD, known.told, strict=True)))
        else:
            self._said.append(_AT_THE_END)

    @property
    def calibrated(self) -> bool:
        """True if the session has a calibration by now."""
        return self._session.calibration is not None

    def _note(self, outcome: Outcome) -> None:
        self._said += outcome.said
        self.turned = self.turned or bool(self._session.learnt.turned)
        for made in outcome.calibrations:
            self._known[made.id] = made.matrix, self._recording.name
            self._untaught &= made.method != WORN

    def corrected(self) -> CorrectedRecording:
        last, rows, session = self._last, self.rows, self._session
        if last is None or rows.filled != len(self._recording):
            raise RuntimeError(
                f"{self._recording.name}: only {rows.filled} of {count(len(self._recording), 'sample')} were corrected"
            )
        matrix, name = self._known[last.calibration]
        if self._untaught:
            self._said.insert(0, _NO_ACCEL if self._recording.accel is None else _UNTAUGHT)
        if self._smooth:
            smoothing.smooth_rows(rows, self._recording, session, last, matrix)
        return CorrectedRecording(
            time_s=self._recording.time_s,
            rate=rows.rate,
            rate_std=rows.rate_std,
            bias=rows.bias,
            bias_std=rows.bias_std,
            quality=rows.quality,
            quat_wxyz=rows.quat_wxyz,
            tilt_std=rows.tilt_std,
            heading_std=rows.heading_std,
            matrix=matrix,
            accelerometer=session.learnt.accelerometer,
            calibration=name,
            rate_hz=self._recording.rate_hz,
            smoothed=self._smooth,
            events=session.sequence.events.as_dict(),
            said=tuple(self._said),
        )


def _usable(calibration: Calibration | Result, recording: Recording) -> Calibration:
    if calibration.verdict is not Verdict.ACCEPTED:
        raise ValueError(
            f"a calibration with verdict {calibration.verdict.name} cannot correct a recording: {english(*calibration.reason)}"
        )
    known = of_result(calibration) if isinstance(calibration, Result) else calibration
    if known.device and recording.device and known.device != recording.device:
        raise RecordingError(
            f"calibration {known.id} is of {known.device}, but recording {recording.name} is of {recording.device}: "
            f"give a calibration of {recording.device}, or none"
        )
    return known if known.id else replace(known, id="given")


def _foreign(known: Calibration, recording: Recording, gyro_range: float) -> str | None:
    """Return why a calibration cannot be of the recording's boot, or None; unknown values are no reason."""
    if known.boot and recording.boot and known.boot != recording.boot:
        was, now = keys.boot_id(known.boot), keys.boot_id(recording.boot)
        return f"calibration {known.id} is of boot {was}, but recording {recording.name} is of boot {now}"
    if gyro_range and known.gyro_range and not isclose(gyro_range, known.gyro_range, rel_tol=1e-3):
        was, now = np.degrees(known.gyro_range), np.degrees(gyro_range)
        return f"calibration {known.id} was made at a range of {was:.5g} °/s, but {recording.name} has {now:.5g} °/s"
    if known.rate_hz and not same_rate(recording.rate_hz, known.rate_hz):
        return f"calibration {known.id} was made at {known.rate_hz:.5g} Hz, but {recording.name} has {recording.rate_hz:.5g} Hz"
    return None
