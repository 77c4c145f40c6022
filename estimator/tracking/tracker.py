"""Bias tracker of one boot: updates the bias (rad/s) with every kind of evidence, from blocks of one second of samples."""

from dataclasses import dataclass
from math import sqrt

import numpy as np

from estimator.geometry.gyro_model import Floats, GyroModel
from estimator.geometry.strapdown import Span, sum_up
from estimator.tracking.bias_filter import Step
from estimator.tracking.bias_state import BIAS, OWN, SLOPE, start
from estimator.tracking.evidence import GATES, Evidence, Receipt
from estimator.tracking.gravity import ACCEL_BIAS, GRAVITY, MATRIX
from estimator.tracking.seconds import CLIPPED, LENGTH_S, Second
from estimator.tracking.tracked_bias import TrackedBias
from estimator.tracking.zaru import UNPROVEN
from estimator.tracking.zaru_limits import QUASI_STATIC

#: s, tolerance when the end of a restored state is compared with the start of a second
_SAME_S = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class RestBias:
    """Rest as a measurement of the bias: mean reading (3,), rad/s, with covariance cov (3, 3), (rad/s)².

    common_var (3,): part of the variance that is the same error in all readings, (rad/s)².
    middle, end: device time, s.
    """

    bias: Floats
    cov: Floats
    common_var: Floats
    middle: float
    end: float


class Tracker(TrackedBias):
    """Bias tracker of one boot: takes one-second blocks of samples; gives the bias, its uncertainty, and reasons to doubt it."""

    def calibrated(self, model: GyroModel, cov: Floats, time: float, rest: RestBias) -> None:
        """Restart from a calibration: its bias with covariance cov (3, 3), (rad/s)², at device time `time`, s.

        model: gyro model of the calibration, with its bias. rest: the bias measured in the rest after the last turn.
        """
        before = self._filter.state
        begun = start(
            model.bias, cov, time, self.knobs.bias, temperature_c=self.thermometer.at(time), powered=before.powered
        )
        self._believe(model, begun)
        self._accelerometer.anew()
        if self.law is not None:
            self._filter.expect(self.law)
        if time < rest.middle:
            # The rest is newer than the calibrated bias.
            self._filter.predict(rest.middle, self.thermometer.at(rest.middle))
            H = np.eye(3, OWN)
            R = rest.cov + QUASI_STATIC**2 * np.eye(3)
            self._filter.update(Evidence("zaru", rest.bias, H, R, GATES[3], rest.common_var))
        self._filter.predict(max(rest.end, before.time), self.thermometer.at(rest.end))
        self._evidence_time = rest.end
        self._gap, self._evidenced = None, True
        self.doubt.anew()

    def learn(self, second: Second) -> list[Receipt]:
        """Update bias, temperature and gravity from a one-second block of samples.

        second: the block; blocks must come in the order of time.
        Returns the receipts of the measurements of the bias at rest or in quiet motion, possibly none.
        """
        self.thermometer.read(second.end, second.celsius)
        receipts = self._second(second)
        if heard := [*self._zaru.judged(), *receipts]:
            self.doubt.take(heard, self._zaru.surprises(), rested=self._zaru.rested)
        return heard

    def _second(self, second: Second) -> list[Receipt]:
        if self._kept is not None:
            if second.start <= self._kept.time - _SAME_S:
                # The evidence of this second is already in the restored state: it must not count twice.
                self._filter.look_back(self._kept, second.end, self.thermometer.at(second.end))
                return []
            self._filter.restart(self._kept)
            self.thermometer.go_on(self._kept.time, self._kept.temperature_c)
            self._kept = None
        if not self._accelerometer.fit(second) and second.accel is not None:
            self._without_accelerometer()
            second = second._replace(accel=None, accel_mean=None, accel_std=None)
        span, carried = self._carried(second)
        if second.flaw:
            # A reading stuck at the end of its range is marked as clipped too, but shows no movement.
            off = np.abs(second.gyro - self._filter.x[BIAS]).max() if second.flaw == CLIPPED else 0.0
            self._lost_way(second.end - second.start, turned=bool(off > self.knobs.quiet_gyro))
        # A second is complete only later, after a gap much later: take the temperature at its end.
        step = self._filter.predict(second.end, self.thermometer.at(second.end), carried)
        receipts = [] if second.flaw else self._evidence(second, span)
        if step is not None:
            since, widened = min(self._evidence_time, second.start), self._filter.widened
            since = since if self._evidenced else -np.inf
            Q = step.Q
            if self._filter.against_law > self.knobs.refuted_sigmas:
                Q[SLOPE, SLOPE] += self._filter.unlearn()
                self.law, self.law_refuted = None, True
            if widened is not None:
                self._supposed = None  # the bias has jumped: that of the turn-on tells nothing of it
                Q[BIAS, BIAS] += widened * (second.end - second.start) / (second.end - since)
                self._history.doubt(widened, since, second.end)
            self._history.add(second.end, self._filter.x, self._filter.cov, step, self._filter.bent)
        if receipts and any(r.accepted and r.reason != UNPROVEN for r in receipts):
            if second.end - self._evidence_time >= self.knobs.gap_s:
                begin = self._evidence_time if self._gap is None else self._gap[0]
                self._gap = begin, second.end
            self._evidence_time, self._evidenced = second.end, True
        self._filter.settle()
        return receipts

    def _lost_way(self, seconds: float, *, turned: bool = False) -> None:
        """Drop what waits to be judged, before predicting over a time without usable samples.

        turned: whether the device is known to have moved in that time.
        """
        self._gravity.lose()
        if turned:  # movement is certain
            self._zaru.moved(self._filter)
        else:
            self._zaru.unseen(self._filter, max(0.0, seconds))
        self._bounded.seconds.clear()

    def _without_accelerometer(self) -> None:
        """Continue with the gyro alone; a disbelieved accelerometer may have misled the bias by an unknown amount."""
        self._gravity.lose()
        if self._accelerometer.disbelieved and len(self._filter.x) > OWN:
            state, doubt = self._filter.state, self.knobs.bias_std**2 * np.eye(3)
            self._believe(self._model, state)
            self._filter.widen(doubt)
            # The smoothed past is misled too, back to the last accepted rest.
            now = self._filter.time
            since = min(self._evidence_time, now - LENGTH_S)
            self._history.doubt(doubt, since if self._evidenced else -np.inf, now)

    def _carried(self, second: Second) -> tuple[Span | None, Step | None]:
        """Sum up a second, and carry gravity over it; (None, None) when the motion in it is unknown."""
        if second.flaw or second.accel is None:
            self._gravity.lose()
            return None, None
        bias = self._filter
        if len(bias.x) == OWN:
            bias.extend(self._gravity.extend(bias.state, self._model.scale_std, self._model.cross_std))
        x, matrix = bias.x, self._model.matrix
        span = sum_up(second.dt, second.gyro, second.accel, matrix, x[BIAS], x[ACCEL_BIAS], x[MATRIX])
        noise = max(second.noise_std.tolist()) * sqrt(span.seconds / second.samples)
        return span, self._gravity.carry(span, bias, noise, second.unseen_turn, second.unseen_push)

    def _evidence(self, second: Second, span: Span | None) -> list[Receipt]:
        """Apply all evidence of a whole second; returns receipts of rest."""
        quiet = max(second.std.tolist()) < self.knobs.quiet_gyro and (
            second.accel_std is None or max(second.accel_std.tolist()) < self.knobs.quiet_accel
        )
        resting = quiet and self._zaru.at_rest(second)
        gravity, up = None, None
        if span is not None:
            gravity, up = self._gravity.evidence(span, resting=resting), self._filter.x[GRAVITY]
        if resting:
            self._bounded.seconds.clear()
            receipts, said = self._zaru.take(second, self._filter, up, gravity)
            if self._zaru.proven and all(receipt.accepted for receipt in receipts):
                self._learn_walk(second)
        else:
            receipts, said = [], None if gravity is None else self._filter.update(gravity)
            if quiet:
                self._zaru.interrupted(self._filter, second.end - second.start)
                receipts = self._bounded.take(second, self._filter, None if span is None else self._filter.x[GRAVITY])
            else:
                self._zaru.moved(self._filter)
                self._bounded.seconds.clear()
        if said is not None and span is not None:
            self._gravity.heard(said, span, resting=resting)
            self._accelerometer.heard(said)
        return receipts

    def _learn_walk(self, second: Second) -> None:
        if self._walk.take(second, self._filter.state, self.knobs.bias, self._began):
            self._filter.pace = self._walk.pace
