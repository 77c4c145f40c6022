"""The bias of one boot, from its first sample on: the filter, the evidence that feeds it, and whether it is to be doubted."""

from dataclasses import dataclass, field, replace
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from bridge.reasons.codes import Sentences
from estimator.geometry.gyro_model import GyroModel
from estimator.geometry.strapdown import Span, sum_up
from estimator.state import StateStruct
from estimator.stillness.detector import Windows
from estimator.tracking.accelerometer_check import AccelerometerCheck, AccelerometerKnobs, AccelerometerState
from estimator.tracking.bias_filter import BIAS, OWN, SLOPE, BiasFilter, BiasKnobs, BiasState, FilterState, Step, start
from estimator.tracking.bias_monitor import BiasMonitor, BiasMonitorKnobs, BiasMonitorState
from estimator.tracking.bounded_motion import BoundedMotion, BoundedMotionKnobs, BoundedMotionState
from estimator.tracking.evidence import GATES, Evidence, Receipt
from estimator.tracking.gravity import ACCEL_BIAS, GRAVITY, MATRIX, SIZE, Gravity, GravityKnobs, GravityState
from estimator.tracking.seconds import CLIPPED, Second, SecondKnobs, Seconds, SecondsState
from estimator.tracking.smoother import History, Smoothed
from estimator.tracking.temperature_law import TemperatureLaw
from estimator.tracking.thermometer import Thermometer, ThermometerKnobs, ThermometerState
from estimator.tracking.zaru import UNPROVEN, Zaru, ZaruKnobs, ZaruState

Floats = NDArray[np.float64]

#: seconds begin and end at the same moments of the device, whoever counts them
_SAME_S = 1e-3


@dataclass(frozen=True, slots=True)
class TrackKnobs:
    """How a bias is tracked. Device seconds, rad/s, m/s²."""

    #: a bias less certain than this is not known
    bias_std: float = np.radians(0.2)
    #: a slope by temperature so many standard deviations from what earlier boots taught refutes them
    refuted_sigmas: float = 4.0
    #: a device that moves no more than this is quiet: asleep, say
    quiet_gyro: float = np.radians(5.0)
    quiet_accel: float = 1.0
    #: evidence after so long a gap improves the past, s, once this much of it has come, s
    gap_s: float = 10.0
    settled_s: float = 5.0
    #: seconds kept for smoothing; None keeps all
    history: int | None = 256
    bias: BiasKnobs = field(default_factory=BiasKnobs)
    seconds: SecondKnobs = field(default_factory=SecondKnobs)
    zaru: ZaruKnobs = field(default_factory=ZaruKnobs)
    gravity: GravityKnobs = field(default_factory=GravityKnobs)
    bounded: BoundedMotionKnobs = field(default_factory=BoundedMotionKnobs)
    accelerometer: AccelerometerKnobs = field(default_factory=AccelerometerKnobs)
    thermometer: ThermometerKnobs = field(default_factory=ThermometerKnobs)
    doubt: BiasMonitorKnobs = field(default_factory=BiasMonitorKnobs)


@dataclass(frozen=True, slots=True, eq=False)
class RestBias:
    """A rest as a measurement of the bias: mean (3,) rad/s, its covariance (3, 3), the variance (3,) its readings share.

    middle and end in device seconds.
    """

    bias: Floats
    cov: Floats
    common_var: Floats
    middle: float
    end: float


class TrackerState(StateStruct):
    """All of a tracker that evolves, but for the smoother's history: what is smoothed later begins here."""

    filter: FilterState
    law: TemperatureLaw | None
    law_refuted: bool
    gravity: GravityState
    zaru: ZaruState
    bounded: BoundedMotionState
    seconds: SecondsState
    thermometer: ThermometerState
    accelerometer: AccelerometerState
    doubt: BiasMonitorState
    evidenced: bool
    evidence_time: float
    gap: tuple[float, float] | None
    kept: BiasState | None


class Tracker:
    """Windows in; the bias, and a reason to doubt or to trust it, out.

    model: what is believed of the gyro at `began`, device seconds, its bias with standard deviation bias_std (3,) rad/s.
    law: what earlier boots taught of temperature; given up for the rest of the boot when the present one disagrees.
    """

    def __init__(
        self, knobs: TrackKnobs, began: float, model: GyroModel, bias_std: Floats, law: TemperatureLaw | None = None
    ) -> None:
        self.knobs = knobs
        self.seconds = Seconds(knobs.seconds)
        self.thermometer = Thermometer(knobs.thermometer)
        self.doubt = BiasMonitor(knobs.doubt)
        self._history = History(knobs.history)
        self._accelerometer = AccelerometerCheck(knobs.accelerometer)
        self._evidenced = False  # whether a rest has ever been seen in this boot, as far as is known
        self._began = self._evidence_time = began
        self._gap: tuple[float, float] | None = None  # without evidence from, to
        self._law = law
        #: whether this boot goes otherwise with temperature than earlier ones did
        self.law_refuted = False
        self.supposed(model, bias_std, began)

    def _believe(self, model: GyroModel, state: BiasState) -> None:
        """Go on from a state, with this model's matrix."""
        self._model = model
        self._gravity = Gravity(self.knobs.gravity)
        self._filter = BiasFilter(replace(state, x=state.x[:OWN], P=state.P[:OWN, :OWN]), self.knobs.bias, self._law)
        known = bool((state.std < self.knobs.bias_std).all())
        self._zaru, self._bounded = Zaru(self.knobs.zaru, known=known), BoundedMotion(self.knobs.bounded)
        self._kept: BiasState | None = None  # what was restored, while seconds come that it knows of

    def saved(self) -> TrackerState:
        """All that evolves: for `encode`, at once, as it goes on to evolve."""
        return TrackerState(
            self._filter.saved,
            self._law,
            self.law_refuted,
            self._gravity.state,
            self._zaru.saved(self._filter),
            self._bounded.state,
            self.seconds.state,
            self.thermometer.state,
            self._accelerometer.state,
            self.doubt.state,
            self._evidenced,
            self._evidence_time,
            self._gap,
            self._kept,
        )

    def go_on(self, saved: TrackerState, model: GyroModel, first: int, samples: Floats) -> None:
        """Go on from what was saved, bit for bit; samples: see Seconds.restore. Raises ValueError, and is then of no use."""
        self._model, self._law, self.law_refuted = model, saved.law, saved.law_refuted
        self._filter.resume(saved.filter, saved.law)
        if len(self._filter.x) not in (OWN, SIZE):
            raise ValueError("damaged state: no state of a bias filter")
        self._gravity.restore(saved.gravity)
        self._zaru.restore(saved.zaru, self._filter)
        self._bounded.restore(saved.bounded)
        self.seconds.restore(saved.seconds, first, samples)
        self.thermometer.state, self._accelerometer.state = saved.thermometer, saved.accelerometer
        self.doubt.restore(saved.doubt)
        self._evidenced, self._evidence_time, self._gap = saved.evidenced, saved.evidence_time, saved.gap
        self._kept = saved.kept

    # ---- what is known --------------------------------------------------------------------------------------------

    @property
    def state(self) -> BiasState:
        """The estimate as it is now."""
        return self._filter.state

    @property
    def worth_keeping(self) -> BiasState:
        """The estimate with all of its evidence: now's, or what was restored until it is reached."""
        return replace(self.state, lag_k=self.thermometer.lag) if self._kept is None else self._kept

    @property
    def time(self) -> float:
        """The end of the last second, device s."""
        return self._filter.time

    @property
    def bias(self) -> Floats:
        """(3,) the reading at zero rate as it is believed now."""
        return self._filter.x[BIAS].copy()

    @property
    def std(self) -> Floats:
        """(3,) its standard deviation: the filter's own, more where its innovations show that it is too sure of itself."""
        return np.asarray(np.sqrt(self._filter.cov.diagonal()[BIAS]) * self.doubt.consistency.inflation)

    def ahead(self, time: float, celsius: float | None = None) -> tuple[Floats, Floats]:
        """Bias and its deviation, (3,) each, at a device time that the tracker may not have come to yet, where it is so warm."""
        if not time > self.time:
            return self.bias, self.std
        now = self._filter
        own = replace(now.state, x=now.x[:OWN], P=now.cov[:OWN, :OWN])
        then = BiasFilter(own, self.knobs.bias, now.law)
        then.predict(time, now.temperature_c if celsius is None else self.thermometer.ahead(time, celsius))
        std = np.sqrt(then.cov.diagonal()[BIAS]) * self.doubt.consistency.inflation
        return then.x[BIAS], np.asarray(std)

    @property
    def sure(self) -> bool:
        """Whether anything worth telling is known of this boot's bias."""
        most = self.knobs.bias_std / self.doubt.consistency.inflation
        return all(var < most * most for var in self._filter.cov.diagonal()[BIAS].tolist())

    def evidence_age(self, now: float) -> float:
        """Seconds since a rest was last accepted; infinite where none is known of: what was restored does not tell."""
        return now - self._evidence_time if self._evidenced else np.inf

    @property
    def events(self) -> dict[str, int]:
        """What was found wrong with the readings, counted."""
        disbelieved = {"accelerometer disbelieved": 1} if self._accelerometer.state.disbelieved else {}
        spikes = {"spike": self.seconds.spikes} if self.seconds.spikes else {}
        return {**spikes, **disbelieved}

    def smoothed(self, since: float = -np.inf) -> Smoothed | None:
        """The bias of each second after `since` by all that is known now; no surer than innovations allow."""
        found = self._history.smoothed(since)
        return None if found is None else replace(found, std=found.std * self.doubt.consistency.inflation)

    def improved(self) -> tuple[float, Smoothed] | None:
        """Once after each gap, when evidence has come back: how long it was, s, and the bias of each second since its begin."""
        if self._gap is None or self._evidence_time - self._gap[1] < self.knobs.settled_s:
            return None
        (begin, end), self._gap = self._gap, None
        smoothed = self.smoothed(begin)
        return None if smoothed is None else (end - begin, smoothed)

    # ---- what comes in --------------------------------------------------------------------------------------------

    def supposed(self, model: GyroModel, bias_std: Floats, time: float) -> None:
        """Begin anew from what is believed of the gyro at a time before anything of this boot is known."""
        self._believe(model, start(model.bias, np.diag(bias_std**2), time, self.knobs.bias, powered=self._began))

    def rescaled(self, model: GyroModel) -> None:
        """The matrix is another one than was said, or known otherwise; the bias is what it was."""
        self._model = model
        if len(self._filter.x) > OWN:
            self._filter.extend(self._gravity.extend(self._filter.state, model.scale_std, model.cross_std))

    def calibrated(self, model: GyroModel, cov: Floats, time: float, rest: RestBias) -> None:
        """Begin anew from a calibration: its bias with covariance (3, 3) at a time, and the rest after the last turn."""
        before = self._filter.state
        begun = start(
            model.bias, cov, time, self.knobs.bias, temperature_c=self.thermometer.at(time), powered=before.powered
        )
        self._believe(model, begun)
        self._accelerometer.anew()
        if self._law is not None:
            self._filter.expect(self._law)
        if time < rest.middle:
            # That rest is newer than the one the bias came from.
            self._filter.predict(rest.middle, self.thermometer.at(rest.middle))
            H = np.eye(3, OWN)
            R = rest.cov + self.knobs.zaru.quasi_static**2 * np.eye(3)
            self._filter.update(Evidence("zaru", rest.bias, H, R, GATES[3], rest.common_var))
        self._filter.predict(max(rest.end, before.time), self.thermometer.at(rest.end))
        self._evidence_time = rest.end
        self._gap, self._evidenced = None, True
        self.doubt.anew()

    def restored(self, model: GyroModel, state: BiasState, now: float, temperature_c: float | None = None) -> None:
        """Go on from a state that was kept, at a temperature; what comes of the time before it teaches nothing of the bias."""
        self._believe(model, state)
        self._zaru.state.rested = False
        self.doubt.anew()
        self._evidence_time = min(state.time, now)
        self._kept = replace(self._filter.state, lag_k=state.lag_k) if now < state.time else None
        if 0 < now - state.time < self.knobs.thermometer.average_s:
            self.thermometer.go_on(state.time, state.temperature_c)
        if temperature_c is not None:
            self.thermometer.go_on_with(now, temperature_c, state.lag_k)
        celsius = np.nan if temperature_c is None else self.thermometer.now
        if self._kept is None:
            self._filter.predict(now, celsius)
        else:  # a bus's cache
            self._filter.look_back(self._kept, now, celsius)

    def expect(self, law: TemperatureLaw) -> None:
        """Use what earlier boots taught of temperature from now on."""
        self._law = law
        self._filter.expect(law)

    def follow(self, law: TemperatureLaw) -> None:
        """The same, of a bias whose slope was learnt under such a law already."""
        self._law = law
        self._filter.follow(law)

    def skip(self, windows: Windows) -> None:
        """Take no notice of the next windows."""
        self.seconds.skip(windows)

    def take(self, windows: Windows) -> list[Receipt]:
        """Take the next windows; receipts of what rest there was in seconds they complete."""
        receipts = []
        for _, second in self.seconds.take(windows):
            receipts += self.learn(second)
        return receipts

    def learn(self, second: Second) -> list[Receipt]:
        """Learn from the next of its seconds; receipts of what rest there was."""
        receipts = self._second(second)
        if heard := [*self._zaru.judged(), *receipts]:
            self.doubt.take(heard, self._zaru.surprises(), rested=self._zaru.state.rested)
        return heard

    def _second(self, second: Second) -> list[Receipt]:
        if self._kept is not None:
            if second.start <= self._kept.time - _SAME_S:
                # Its evidence is in what was kept: none may count twice, not even for a while.
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
            # A reading that is stuck is marked as one at its end is, and shows no movement.
            off = np.abs(second.gyro - self._filter.x[BIAS]).max() if second.flaw == CLIPPED else 0.0
            self._lost_way(second.end - second.start, turned=bool(off > self.knobs.quiet_gyro))
        # Known whole only later, over a gap much later: it was as warm as it was then.
        step = self._filter.predict(second.end, self.thermometer.at(second.end), carried)
        receipts = [] if second.flaw else self._evidence(second, span)
        if step is not None:
            since, widened = min(self._evidence_time, second.start), self._filter.widened
            since = since if self._evidenced else -np.inf
            Q = step.Q
            if self._filter.against_law > self.knobs.refuted_sigmas:
                Q[SLOPE, SLOPE] += self._filter.unlearn()
                self._law, self.law_refuted = None, True
            if widened is not None:
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
        """Before time goes on over what nobody saw for so long: what waits to be judged was measured before that."""
        self._gravity.lose()
        if turned:  # so much is known of it
            self._zaru.moved(self._filter)
        else:
            self._zaru.unseen(self._filter, max(0.0, seconds))
        self._bounded.broken()

    def _without_accelerometer(self) -> None:
        """Go on with the gyro alone; one that was given up has misled the bias by nobody knows how much."""
        self._gravity.lose()
        if self._accelerometer.state.disbelieved and len(self._filter.x) > OWN:
            state, doubt = self._filter.state, self.knobs.bias_std**2 * np.eye(3)
            self._believe(self._model, state)
            self._filter.widen(doubt)
            # What is smoothed has been misled, too, since a rest told last.
            now = self._filter.time
            since = min(self._evidence_time, now - self.knobs.seconds.length_s)
            self._history.doubt(doubt, since if self._evidenced else -np.inf, now)

    def _carried(self, second: Second) -> tuple[Span | None, Step | None]:
        """The way of a second, and where it takes gravity; None where the way it went is not known."""
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
        """All that a whole second says of the bias; receipts of rest."""
        quiet = max(second.std.tolist()) < self.knobs.quiet_gyro and (
            second.accel_std is None or max(second.accel_std.tolist()) < self.knobs.quiet_accel
        )
        resting = quiet and self._zaru.at_rest(second, self._filter)
        gravity, up = None, None
        if span is not None:
            gravity, up = self._gravity.evidence(span, resting=resting), self._filter.x[GRAVITY]
        if resting:
            self._bounded.broken()
            receipts, said = self._zaru.take(second, self._filter, up, gravity)
        else:
            receipts, said = [], None if gravity is None else self._filter.update(gravity)
            if quiet:
                self._zaru.interrupted(self._filter, second.end - second.start)
                receipts = self._bounded.take(second, self._filter, None if span is None else self._filter.x[GRAVITY])
            else:
                self._zaru.moved(self._filter)
                self._bounded.broken()
        if said is not None and span is not None:
            self._gravity.heard(said, span, resting=resting)
            self._accelerometer.heard(said)
        return receipts

    # ---- doubt and trust ------------------------------------------------------------------------------------------

    def doubts(self, now: float) -> Sentences:
        """Why the bias is doubted from now on; none when that is no news, or there is no reason."""
        return self.doubt.news(now - self._evidence_time, gravity=self._gravity_disagrees)

    def trusts(self) -> bool:
        """Whether the last rest has made the bias certain again."""
        age_s = self.time - self._evidence_time
        return self.doubt.settled(age_s, sure=self.sure, gravity=self._gravity_disagrees)

    @property
    def _gravity_disagrees(self) -> bool:
        against = self._accelerometer
        return against.contradicts and float(self._model.scale_std.max()) < against.knobs.scale_std
