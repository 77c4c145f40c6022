"""Tracked bias of one boot: its estimate, what it starts from, and whether it is doubted."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bridge.reasons.codes import Sentences
from estimator.geometry.gyro_model import GyroModel
from estimator.state import StateStruct, shaped
from estimator.tracking.accelerometer_check import AccelerometerCheck, AccelerometerState
from estimator.tracking.bias_filter import BiasFilter, FilterState
from estimator.tracking.bias_monitor import BiasMonitor, BiasMonitorState
from estimator.tracking.bias_state import BIAS, OWN, BiasState, start
from estimator.tracking.bounded_motion import BoundedMotion, BoundedMotionState
from estimator.tracking.gravity import ACCEL_BIAS, MATRIX, SIZE, Gravity, GravityState
from estimator.tracking.seconds import Seconds, SecondsState
from estimator.tracking.smoother import History, Smoothed
from estimator.tracking.temperature_law import TemperatureLaw
from estimator.tracking.thermometer import Thermometer, ThermometerState
from estimator.tracking.track_knobs import TrackKnobs
from estimator.tracking.usual_bias import nearer
from estimator.tracking.walk_rate import WalkRate, WalkState
from estimator.tracking.zaru import Zaru
from estimator.tracking.zaru_state import ZaruState

Floats = NDArray[np.float64]


class TrackerState(StateStruct):
    """Saved state of a tracker without the smoother's history, which begins anew after a restore."""

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
    walk: WalkState
    supposed: Floats | None


class TrackedBias:
    """Bias and its uncertainty, and reasons to doubt or trust them.

    model: gyro model at device time `began`, s; its bias has standard deviation bias_std (3,) rad/s. law: temperature law
    from earlier boots, given up for the rest of the boot when the evidence disagrees with it.
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
        self._evidenced = False  # whether a rest of this boot is known
        self._began = self._evidence_time = began
        self._gap: tuple[float, float] | None = None  # begin and end of the gap in the evidence, s
        self.law = law
        self._walk = WalkRate(knobs.bias, began, knobs.walk)
        #: whether this boot's bias contradicts the temperature law of earlier boots
        self.law_refuted = False
        self.supposed(model, bias_std, began)

    def _believe(self, model: GyroModel, state: BiasState) -> None:
        """Begin anew from a bias state, with this model's matrix."""
        self._model = model
        self._gravity = Gravity(self.knobs.gravity)
        self._filter = BiasFilter(replace(state, x=state.x[:OWN], P=state.P[:OWN, :OWN]), self.knobs.bias, self.law)
        self._filter.pace = self._walk.pace
        known = bool((state.std < self.knobs.bias_std).all())
        self._zaru, self._bounded = Zaru(self.knobs.zaru, known=known), BoundedMotion(self.knobs.bounded)
        self._supposed: Floats | None = None  # (2, 3) prior mean and std of the bias, if only supposed
        self._kept: BiasState | None = None  # restored state, until the stream reaches the time it was saved at

    def saved(self) -> TrackerState:
        """State to save with `encode` at once: its parts are shared with the running tracker."""
        return TrackerState(
            self._filter.saved,
            self.law,
            self.law_refuted,
            self._gravity.state,
            self._zaru.saved(),
            self._bounded.state,
            self.seconds.state,
            self.thermometer.state,
            self._accelerometer.state,
            self.doubt.state,
            self._evidenced,
            self._evidence_time,
            self._gap,
            self._kept,
            self._walk.state,
            self._supposed,
        )

    def go_on(self, saved: TrackerState, model: GyroModel, first: int, samples: Floats) -> None:
        """Restore a saved state, bit for bit; first, samples: see `Seconds.restore`.

        Raises ValueError when the state is damaged; the tracker is then unusable.
        """
        self._model, self.law, self.law_refuted = model, saved.law, saved.law_refuted
        self._filter.resume(saved.filter, saved.law)
        self._walk.restore(saved.walk)
        self._filter.pace = self._walk.pace
        if len(self._filter.x) not in (OWN, SIZE):
            raise ValueError("damaged state: no state of a bias filter")
        self._gravity.restore(saved.gravity)
        self._zaru.restore(saved.zaru)
        self._bounded.restore(saved.bounded)
        self.seconds.restore(saved.seconds, first, samples)
        self.thermometer.state, self._accelerometer.state = saved.thermometer, saved.accelerometer
        self.doubt.restore(saved.doubt)
        self._evidenced, self._evidence_time, self._gap = saved.evidenced, saved.evidence_time, saved.gap
        self._kept, self._supposed = saved.kept, saved.supposed
        if saved.supposed is not None:
            shaped(saved.supposed, 2, 3, finite=True)

    @property
    def state(self) -> BiasState:
        """Current state of the bias filter."""
        return self._filter.state

    @property
    def worth_keeping(self) -> BiasState:
        """State to store for a restart: the current one, or the restored one until the stream reaches its time."""
        return replace(self.state, lag_k=self.thermometer.lag) if self._kept is None else self._kept

    @property
    def time(self) -> float:
        """End of the last tracked second, device time, s."""
        return self._filter.time

    @property
    def bias(self) -> Floats:
        """(3,) estimated bias (reading at zero rate), rad/s."""
        return self._usual(self._filter)

    @property
    def std(self) -> Floats:
        """(3,) standard deviation of the bias, rad/s; enlarged when innovations show that the filter is overconfident."""
        return np.asarray(np.sqrt(self._filter.cov.diagonal()[BIAS]) * self.doubt.consistency.inflation)

    def ahead(self, time: float, celsius: float | None = None) -> tuple[Floats, Floats]:
        """Predict bias and standard deviation, (3,) rad/s each, to a later device time, s, at a temperature, °C."""
        if not time > self.time:
            return self.bias, self.std
        now = self._filter
        own = replace(now.state, x=now.x[:OWN], P=now.cov[:OWN, :OWN])
        then = BiasFilter(own, self.knobs.bias, now.law)
        then.pace = now.pace
        then.predict(time, now.temperature_c if celsius is None else self.thermometer.ahead(time, celsius))
        std = np.sqrt(then.cov.diagonal()[BIAS]) * self.doubt.consistency.inflation
        return self._usual(then), np.asarray(std)

    def _usual(self, now: BiasFilter) -> Floats:
        """(3,) bias of a filter, near what is usual where evidence does not reach."""
        bias: Floats = now.x[BIAS].copy()
        if self._supposed is None:
            return bias
        mean, std = self._supposed
        return nearer(bias, now.cov[BIAS, BIAS], mean, std, self.knobs.usual_bias)

    @property
    def unsure(self) -> Floats | None:
        """(12,) rms errors of the matrix in use, relative, row by row, and of the accelerometer, m/s²; or None."""
        if len(self._filter.x) == OWN:
            return None
        x, var = self._filter.x, self._filter.cov.diagonal()
        return np.concatenate([np.sqrt(var[own] + x[own] ** 2) for own in (MATRIX, ACCEL_BIAS)])

    @property
    def matrix(self) -> Floats:
        """(3, 3) matrix in use; what gravity has taught since is in the state."""
        return self._model.matrix

    @property
    def surer(self) -> bool:
        """Whether gravity has taught the matrix better than it was known, and nothing speaks against bias or accelerometer."""
        knobs = self.knobs.matrix
        if not knobs.learn or len(self._filter.x) == OWN:
            return False
        var = self._filter.cov.diagonal()[MATRIX]
        if not max(var[::4].tolist()) < knobs.scale_std**2:
            return False
        model = self._model
        known = float(np.square(model.scale_std).sum() + 2 * np.square(model.cross_std).sum())
        if not float(var.sum()) < knobs.left * known:
            return False
        return self.sure and not self.doubt.stands and not self._accelerometer.contradicts

    @property
    def sure(self) -> bool:
        """Whether the bias is known better than `TrackKnobs.bias_std` on all axes."""
        most = self.knobs.bias_std / self.doubt.consistency.inflation
        return all(var < most * most for var in self._filter.cov.diagonal()[BIAS].tolist())

    def evidence_age(self, now: float) -> float:
        """Seconds since a rest was last accepted; infinite when none of this boot is known, as after a restore."""
        return now - self._evidence_time if self._evidenced else np.inf

    @property
    def events(self) -> dict[str, int]:
        """Faults found in the readings, counted by name."""
        disbelieved = {"accelerometer disbelieved": 1} if self._accelerometer.state.disbelieved else {}
        spikes = {"spike": self.seconds.spikes} if self.seconds.spikes else {}
        return {**spikes, **disbelieved}

    def smoothed(self, since: float = -np.inf) -> Smoothed | None:
        """Smoothed bias of each second after `since`; its std is enlarged like `std`. None without data."""
        found = self._history.smoothed(since)
        return None if found is None else replace(found, std=found.std * self.doubt.consistency.inflation)

    def improved(self) -> tuple[float, Smoothed] | None:
        """Length of the last gap in the evidence, s, and the smoothed bias since its begin; None except once after a gap."""
        if self._gap is None or self._evidence_time - self._gap[1] < self.knobs.settled_s:
            return None
        (begin, end), self._gap = self._gap, None
        smoothed = self.smoothed(begin)
        return None if smoothed is None else (end - begin, smoothed)

    def supposed(self, model: GyroModel, bias_std: Floats, time: float) -> None:
        """Begin anew from a gyro model with bias_std (3,) rad/s at a time, s, while nothing of this boot is known."""
        self._believe(model, start(model.bias, np.diag(bias_std**2), time, self.knobs.bias, powered=self._began))
        self._supposed = np.array([model.bias, bias_std])

    def rescaled(self, model: GyroModel) -> None:
        """Replace the gyro model's matrix and its uncertainty; the bias is kept."""
        self._model = model
        if len(self._filter.x) > OWN:
            self._filter.extend(self._gravity.extend(self._filter.state, model.scale_std, model.cross_std))

    def corrected_by(self, model: GyroModel) -> None:
        """Use the matrix that gravity taught (`surer`) as the gyro model's; all else goes on."""
        self._model = model
        x = self._filter.x.copy()
        x[MATRIX] = 0.0
        self._filter.extend(replace(self._filter.state, x=x))

    def restored(self, model: GyroModel, state: BiasState, now: float, temperature_c: float | None = None) -> None:
        """Continue from a stored bias state at device time `now`, s; samples from before the state teach nothing."""
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
        else:  # the stream begins with older samples, from a bus's cache
            self._filter.look_back(self._kept, now, celsius)

    def expect(self, law: TemperatureLaw) -> None:
        """Use a temperature law from now on; its slope replaces the tracked one."""
        self.law = law
        self._filter.expect(law)

    def follow(self, law: TemperatureLaw) -> None:
        """Use a temperature law from now on, for a bias whose slope was learnt under it; the slope is kept."""
        self.law = law
        self._filter.follow(law)

    def doubts(self, now: float) -> Sentences:
        """Reasons why the bias is doubted from now on; empty when there is none or the doubt is not new."""
        return self.doubt.news(now - self._evidence_time, gravity=self._gravity_disagrees)

    def trusts(self) -> bool:
        """Whether the last rest has ended the doubt of the bias."""
        age_s = self.time - self._evidence_time
        return self.doubt.settled(age_s, sure=self.sure, gravity=self._gravity_disagrees)

    @property
    def _gravity_disagrees(self) -> bool:
        against = self._accelerometer
        return against.contradicts and float(self._model.scale_std.max()) < against.knobs.scale_std
