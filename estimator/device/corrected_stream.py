"""Correction of one device's samples without delay, and block by block updates of its bias and calibration.

Estimates from one block of device time (`estimator.samples.blocks`) are applied from the end of the next block on. So
corrected rates do not depend on how samples are batched, and the caller may run `learn` whenever there is time.
"""

from functools import partial
from weakref import proxy

import numpy as np

from bridge.wire.messages import Calibration, DeviceCalibration, DeviceInfo
from estimator.calibration.result import Result
from estimator.device.batch_correction import Cut
from estimator.device.boot_estimation import BootEstimation
from estimator.device.lifecycle import Event, Lifecycle
from estimator.device.outcome import Outcome
from estimator.device.sequence_numbers import SequenceNumbers
from estimator.device.session_knobs import SessionKnobs
from estimator.device.window_summary import Second
from estimator.orientation.attitude import Attitude
from estimator.samples.blocks import BLOCK_S, SHORT_S, Blocks
from estimator.samples.sample_buffer import CELSIUS, TIME, Samples, known
from estimator.tracking.temperature_law import TemperatureLaw
from estimator.tracking.tracker import Tracker

#: s; after a longer silence the bias is less certain from the first sample on, before the next second is judged
SILENCE_S = 5.0


class CorrectedStream:
    """Corrector of one device's samples over successive boots; updates bias and calibration from the samples.

    device: its id. knobs: settings of the session. began: device time of the first boot's start, s.
    sequence: sequence counters to continue; new ones by default.
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
        #: whether summaries per window (`window_summary`) are wanted; only then the samples of a block are kept for them
        self.windowed = False
        #: orientation of the current boot; None while nobody wants it
        self.attitude: Attitude | None = None
        self._offered: DeviceCalibration | None = None  # the device's own calibration that was judged last
        self._begin(began)
        self._unused = True  # no boot has begun since `_begin`

    def _begin(self, device_time: float, law: TemperatureLaw | None = None) -> None:
        # A proxy: a reference cycle would keep an ended session in memory until Python's cycle collector runs.
        made = partial(as_message, proxy(self))
        self.learnt = BootEstimation(self.knobs, device_time, law, self.life, self.sequence.events, made)
        self._blocks = Blocks(device_time)
        #: correction applied to the next samples; and from the end of this block on
        self.applied = self._ready = self.learnt.correction()
        #: sample numbers of the last whole block, until it is learnt from
        self._lesson: tuple[int, int] | None = None
        self._lesson_applied = self.applied  # correction that was applied to that block, and its length, s
        self._lesson_s = self._blocks.length_s

    def orient(self) -> None:
        """Start or restart the orientation estimate; the heading is zero at the first sample from now on."""
        self.attitude = Attitude()

    @property
    def boot(self) -> int | None:
        """Boot id whose samples are accepted; None before the first boot."""
        return self.sequence.boot

    @property
    def calibration(self) -> Calibration | None:
        """Calibration of the current boot, or None."""
        return self.learnt.calibration

    @property
    def prior(self) -> Calibration | None:
        """Calibration of an earlier boot under the same restore key (model, firmware, range, rate), or None."""
        return self.learnt.prior

    @property
    def tracker(self) -> Tracker:
        """Bias tracker of the current boot: a Kalman filter for the bias and its slope by temperature."""
        return self.learnt.tracker

    def begins_earlier(self, samples: Samples) -> bool:
        """Return whether `samples` are the first of the boot and lie before its assumed start in device time."""
        return self.sequence.next is None and samples.first_s < self.learnt.began

    def take(self, samples: Samples, cuts: list[Cut]) -> Outcome | None:
        """Accept samples of the current boot, and assign a correction to each; `batch_correction.correct` applies it.

        samples: all finite. Late and repeated samples are counted and dropped. cuts: receives the segments of the
        samples, each with its correction. Returns the outcome of earlier blocks that this call processed, or None.
        """
        first = self.sequence.fresh(samples)
        if first == samples.n:
            return None
        away_s = max(0.0, (samples.receive_time_ns - self.last_heard_ns) / 1e9 / samples.clock_rate)
        self.last_heard_ns, outcome = samples.receive_time_ns, None
        if self.life.away and self.life.on(Event.HEARD):
            self._apply()
            outcome = Outcome(changed=True, said=["heard again"])
        blocks, start = self._blocks, first
        if blocks.went_back(samples.rows.item(first, TIME) if first else samples.first_s, away_s):
            self.sequence.events.add("device clock went back")
        for edge, now, before in blocks.put(samples, first):
            applied, outcome = self.applied, outcome or Outcome()
            if now - before > SILENCE_S:
                self._end_block(outcome, (now, known(samples.rows.item(edge, CELSIUS))))
            else:
                self._end_block(outcome)
            if edge > start and self.applied is not applied:
                cuts.append(Cut(samples, applied, start, edge))
                start = edge
        cuts.append(Cut(samples, self.applied, start, samples.n))
        return outcome

    @property
    def to_learn(self) -> bool:
        """True if a finished block of samples waits for `learn`."""
        return self._lesson is not None

    def learn(self) -> Outcome:
        """Update bias and calibration from the last finished block; return the outcome.

        If this method is not called, the update happens at the end of the next block. In both cases the new correction
        applies to samples after the end of the next block.
        """
        outcome = Outcome()
        self._learn(outcome)
        return outcome

    def _end_block(self, outcome: Outcome, resumed: tuple[float, float | None] | None = None) -> None:
        """End a block: the next update uses it, and the correction from earlier blocks takes effect.

        resumed: device time, s, and temperature, °C, of the next sample when a silence lies before it.
        """
        self._learn(outcome)
        self._lesson_s = self._blocks.length_s
        self._blocks.length_s = SHORT_S if self.learnt.awaited else BLOCK_S
        if resumed is not None:
            self.learnt.resumed(*resumed)
            self._ready = self.learnt.correction()
        self._lesson, self._lesson_applied = self._blocks.end_block(), self.applied
        self.applied = self._ready

    def _learn(self, outcome: Outcome) -> None:
        if self._lesson is None:
            return
        (begin, end), self._lesson, buffer = self._lesson, None, self._blocks.buffer
        of = self.device, self.boot or 0
        if self.windowed:
            block = buffer.rows(begin, end).copy(), buffer.places(begin, end).copy()
            outcome.seconds.append(Second(*of, *block, self._lesson_applied))
        if self.learnt.learn(buffer, end, of, outcome):  # an unchanged correction does not cut a batch
            self._ready = self.learnt.correction()

    def end(self) -> Outcome:
        """Finish the stream: process its last blocks without waiting for more samples; return the outcome."""
        outcome = Outcome()
        self._end_block(outcome)
        self._learn(outcome)
        return outcome

    def count_event(self, name: str) -> int:
        """Count an event of this device that happened outside the session, by its name; return the new count."""
        return self.sequence.events.add(name)

    def _apply(self) -> None:
        """Apply the latest correction at once: the change did not come from samples."""
        self.applied = self._ready = self.learnt.correction()


def as_message(session: CorrectedStream, result: Result, who: str, now_ns: int) -> Calibration:
    """Build the calibration message of a result.

    Device, boot, temperature and accelerometer calibration come from the session.
    who: the person who requested the calibration, or empty. now_ns: host time, ns since the Unix epoch; also part of
    the calibration's id.
    """
    info = session.info
    boot = session.boot or 0
    # The wire takes no infinity: parameters that were not estimated are left out.
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
        accelerometer=session.learnt.accelerometer,
    )
