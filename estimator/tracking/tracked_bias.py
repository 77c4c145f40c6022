"""Tracked bias of one boot: its estimate, its start value, and reasons to doubt it."""

from dataclasses import replace

import numpy as np

from bridge.reasons.codes import Sentences
from estimator.geometry.gyro_model import GyroModel
from estimator.state import Floats, StateStruct, shaped
from estimator.tracking.accelerometer_check import SCALE_STD, AccelerometerCheck
from estimator.tracking.bias_filter import BiasFilter, FilterState
from estimator.tracking.bias_monitor import BiasMonitor
from estimator.tracking.bias_state import BIAS, OWN, BiasState, start
from estimator.tracking.bounded_motion import BoundedMotion
from estimator.tracking.gravity import ACCEL_BIAS, MATRIX, SIZE, Gravity, GravityState
from estimator.tracking.seconds import Seconds, SecondsState
from estimator.tracking.smoother import History, Smoothed
from estimator.tracking.temperature_law import TemperatureLaw
from estimator.tracking.thermometer import AVERAGE_S, Thermometer
from estimator.tracking.track_knobs import TrackKnobs
from estimator.tracking.usual_bias import nearer
from estimator.tracking.walk_rate import WalkRate
from estimator.tracking.zaru import Zaru

#: relative standard deviation that every scale factor must reach before the matrix that gravity teaches comes into use
_SCALE_STD = 0.01
#: share of the variance known before, summed over the matrix, that may then be left
_LEFT = 0.8


class TrackerState(StateStruct):
    """Saved state of a tracker, without the stored history of the smoother, which begins anew after a restore.

    law_refuted: True if this boot's bias contradicts the temperature law.
    evidenced: True if a rest of this boot is known.
    evidence_time: device time of the last accepted rest, s.
    gap: start and end of the latest gap in the evidence that is not yet smoothed, device time in s, or None.
    kept: restored bias state, until the samples reach its device time; else None.
    supposed (2, 3): mean and standard deviation of the prior, rad/s, while the bias comes from the gyro model. None
        after a calibration, a restore, or a jump of the bias.
    The other fields are the states of the tracker's parts, such as filter, ZARU and thermometer.
    """

    filter: FilterState
    law: TemperatureLaw | None
    law_refuted: bool
    gravity: GravityState
    zaru: Zaru
    bounded: BoundedMotion
    seconds: SecondsState
    thermometer: Thermometer
    accelerometer: AccelerometerCheck
    doubt: BiasMonitor
    evidenced: bool
    evidence_time: float
    gap: tuple[float, float] | None
    kept: BiasState | None
    walk: WalkRate
    supposed: Floats | None


class TrackedBias:
    """Tracked bias of one boot with its uncertainty, and the reasons to doubt or trust it.

    began: device time of the start, s. model: gyro model at that time, with the first bias.
    bias_std (3,): standard deviation of the model's bias, rad/s.
    law: temperature law from earlier boots, or None. It is given up for the rest of the boot when the evidence
        contradicts it.
    """

    def __init__(
        self, knobs: TrackKnobs, began: float, model: GyroModel, bias_std: Floats, law: TemperatureLaw | None = None
    ) -> None:
        self.knobs = knobs
        self.seconds, self.thermometer, self.doubt = Seconds(), Thermometer(), BiasMonitor()
        self._history, self._accelerometer, self._walk = History(knobs.history), AccelerometerCheck(), WalkRate()
        self._evidenced = False  # whether a rest of this boot is known
        self._began = self._evidence_time = began
        self._gap: tuple[float, float] | None = None  # begin and end of the gap in the evidence, s
        self.law = law
        #: whether this boot's bias contradicts the temperature law of earlier boots
        self.law_refuted = False
        self.supposed(model, bias_std, began)

    def _believe(self, model: GyroModel, state: BiasState) -> None:
        """Restart from a bias state, with this model's matrix."""
        self._model = model
        self._gravity = Gravity(self.knobs.gravity)
        self._filter = BiasFilter(replace(state, x=state.x[:OWN], P=state.P[:OWN, :OWN]), self.knobs.bias, self.law)
        self._filter.pace = self._walk.pace
        known = bool((state.std < self.knobs.bias_std).all())
        self._zaru, self._bounded = Zaru(ever_proven=known), BoundedMotion()
        self._supposed: Floats | None = None  # (2, 3) prior mean and std of the bias, if only supposed
        self._kept: BiasState | None = None  # restored state, until the stream reaches the time it was saved at

    def saved(self) -> TrackerState:
        """State to save for `go_on`. It must be encoded at once, because it is not a copy: the tracker continues to change it."""
        return TrackerState(
            self._filter.saved,
            self.law,
            self.law_refuted,
            self._gravity.state,
            self._zaru,
            self._bounded,
            self.seconds.state,
            self.thermometer,
            self._accelerometer,
            self.doubt,
            self._evidenced,
            self._evidence_time,
            self._gap,
            self._kept,
            self._walk,
            self._supposed,
        )

    def go_on(self, saved: TrackerState, model: GyroModel, first: int, samples: Floats) -> None:
        """Restore a state saved by `saved`; the tracker then continues as if it had not stopped.

        model: the gyro model in use.
        samples (n, 9): the samples still needed; device time (s), gyro (rad/s), accelerometer (m/s²), clipped,
            temperature (°C).
        first: number of the first of these samples, counted from the first one of the stream.
        Raises ValueError when the state is damaged; the tracker is then unusable.
        """
        self._model, self.law, self.law_refuted = model, saved.law, saved.law_refuted
        self._filter.resume(saved.filter, saved.law)
        self._walk, self._filter.pace = saved.walk, saved.walk.pace
        if len(self._filter.x) not in (OWN, SIZE):
            raise ValueError("damaged state: the data is not of a bias filter; start without this state")
        self._gravity, self._zaru, self._bounded = Gravity(self.knobs.gravity, saved.gravity), saved.zaru, saved.bounded
        self.seconds.restore(saved.seconds, first, samples)
        self.thermometer, self._accelerometer, self.doubt = saved.thermometer, saved.accelerometer, saved.doubt
        self._evidenced, self._evidence_time, self._gap = saved.evidenced, saved.evidence_time, saved.gap
        self._kept, self._supposed = saved.kept, saved.supposed
        if saved.supposed is not None:
            shaped(saved.supposed, 2, 3, finite=True)

    @property
    def state(self) -> BiasState:
        """Copy of the current state of the bias filter: bias (rad/s), its slope (rad/s/K), and their covariance."""
        return self._filter.state

    @property
    def worth_keeping(self) -> BiasState:
        """Bias state to store for a restart: the current one, or a restored one until the samples reach its device time."""
        return replace(self.state, lag_k=self.thermometer.lag) if self._kept is None else self._kept

    @property
    def time(self) -> float:
        """Device time of the bias estimate, s: the end of the last one-second block that was processed."""
        return self._filter.time

    @property
    def bias(self) -> Floats:
        """Estimated bias (3,), the reading at zero rate, rad/s.

        An axis that evidence has not reached yet stays near the usual turn-on bias (see usual_bias.py). After a
        calibration or a restore this prior no longer applies.
        """
        return self._usual(self._filter)

    @property
    def std(self) -> Floats:
        """Standard deviation (3,) of the bias, rad/s; enlarged when innovations show that the filter is overconfident."""
        return np.asarray(np.sqrt(self._filter.cov.diagonal()[BIAS]) * self.doubt.consistency.inflation)

    def ahead(self, time: float, celsius: float | None = None) -> tuple[Floats, Floats]:
        """Predict the bias and its standard deviation, (3,) rad/s each, to a later device time, s.

        celsius: temperature reading at that time, °C; None keeps the present temperature.
        """
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
    def taught(self) -> Floats | None:
        """Estimate of gyro matrix errors and accelerometer errors from gravity, (21,); None before accelerometer readings.

        Elements: relative change of the matrix (9, by rows), standard deviations of the changed matrix (9, relative),
        rms errors of the accelerometer (3, m/s²).
        The change is zero until every scale factor has a standard deviation below 1 %. The standard deviations then
        include the change that is left out.
        """
        if len(self._filter.x) == OWN:
            return None
        x, var = self._filter.x, self._filter.cov.diagonal()
        change = x[MATRIX] if self._scale_known else np.zeros(9)
        errors = [np.sqrt(var[MATRIX] + (x[MATRIX] - change) ** 2), np.sqrt(var[ACCEL_BIAS] + x[ACCEL_BIAS] ** 2)]
        return np.concatenate([change, *errors])

    @property
    def _scale_known(self) -> bool:
        return all(var < _SCALE_STD**2 for var in self._filter.cov.diagonal()[MATRIX][::4].tolist())

    @property
    def matrix(self) -> Floats:
        """Gyro matrix (3, 3) in use, no unit, without the later correction from gravity (`taught`)."""
        return self._model.matrix

    @property
    def surer(self) -> bool:
        """True if gravity has determined the gyro matrix better than the model did, so that its correction can be used.

        Requires that the summed variance of the nine elements is below 0.8 of that of the model. Every scale factor
        must be known to 1 %, and the bias to `TrackKnobs.bias_std`.
        False when `TrackKnobs.learn_matrix` is off, while the bias is doubted, or while the accelerometer contradicts
        the bias.
        """
        if not self.knobs.learn_matrix or len(self._filter.x) == OWN or not self._scale_known:
            return False
        var, model = self._filter.cov.diagonal()[MATRIX], self._model
        known = float(np.square(model.scale_std).sum() + 2 * np.square(model.cross_std).sum())
        if not float(var.sum()) < _LEFT * known:
            return False
        return self.sure and not self.doubt.stands and not self._accelerometer.contradicts

    @property
    def sure(self) -> bool:
        """True if the standard deviation of the bias is below `TrackKnobs.bias_std` (rad/s) on all axes."""
        most = self.knobs.bias_std / self.doubt.consistency.inflation
        return all(var < most * most for var in self._filter.cov.diagonal()[BIAS].tolist())

    def evidence_age(self, now: float) -> float:
        """Seconds from the last accepted rest to device time `now`, s.

        Infinite when no rest of this boot is known.
        """
        return now - self._evidence_time if self._evidenced else np.inf

    @property
    def events(self) -> dict[str, int]:
        """Faults found in the readings, as counts by name: `spike`, `accelerometer disbelieved`."""
        disbelieved = {"accelerometer disbelieved": 1} if self._accelerometer.disbelieved else {}
        spikes = {"spike": self.seconds.spikes} if self.seconds.spikes else {}
        return {**spikes, **disbelieved}

    def smoothed(self, since: float = -np.inf) -> Smoothed | None:
        """Smoothed bias, rad/s, at the end of every stored block after device time `since`, s; None without data.

        The standard deviation is multiplied by the same factor for overconfidence as that of `std`.
        """
        found = self._history.smoothed(since)
        return None if found is None else replace(found, std=found.std * self.doubt.consistency.inflation)

    def improved(self) -> tuple[float, Smoothed] | None:
        """Length of the last gap in the accepted evidence, s, and the smoothed bias (rad/s) since its start; once for each gap.

        A gap has at least `TrackKnobs.gap_s` seconds without an accepted measurement at rest or in quiet motion.
        Returns None without a new gap, and until the evidence after the gap has lasted `TrackKnobs.settled_s` seconds.
        """
        if self._gap is None or self._evidence_time - self._gap[1] < self.knobs.settled_s:
            return None
        (begin, end), self._gap = self._gap, None
        smoothed = self.smoothed(begin)
        return None if smoothed is None else (end - begin, smoothed)

    def supposed(self, model: GyroModel, bias_std: Floats, time: float) -> None:
        """Restart tracking from the bias of a gyro model, as a prior without any evidence of this boot.

        bias_std (3,): standard deviation of this bias, rad/s. time: device time, s.
        """
        self._believe(model, start(model.bias, np.diag(bias_std**2), time, self.knobs.bias, powered=self._began))
        self._supposed = np.array([model.bias, bias_std])

    def rescaled(self, model: GyroModel) -> None:
        """Replace the gyro model's matrix; the tracked bias is kept, and the gravity evidence begins anew."""
        self._model = model
        if len(self._filter.x) > OWN:
            self._filter.extend(self._gravity.extend(self._filter.state, model.scale_std, model.cross_std))

    def corrected_by(self, model: GyroModel) -> None:
        """Use a gyro model whose matrix includes the correction estimated from gravity (see `surer`); tracking continues.

        The tracked relative change of the matrix is set to zero; its covariance is kept.
        """
        self._model = model
        x = self._filter.x.copy()
        x[MATRIX] = 0.0
        self._filter.extend(replace(self._filter.state, x=x))

    def restored(self, model: GyroModel, state: BiasState, now: float, temperature_c: float | None = None) -> None:
        """Continue from a stored bias state at device time `now`, s; samples from before the state are not used.

        model: gyro model to use. temperature_c: the device's temperature now, °C, or None when unknown.
        """
        self._believe(model, state)
        self._zaru.rested = False
        self.doubt.anew()
        self._evidence_time = min(state.time, now)
        self._kept = replace(self._filter.state, lag_k=state.lag_k) if now < state.time else None
        if 0 < now - state.time < AVERAGE_S:
            self.thermometer.go_on(state.time, state.temperature_c)
        if temperature_c is not None:
            self.thermometer.go_on_with(now, temperature_c, state.lag_k)
        celsius = np.nan if temperature_c is None else self.thermometer.now
        if self._kept is None:
            self._filter.predict(now, celsius)
        else:  # the stream begins with older samples, from a bus's cache
            self._filter.look_back(self._kept, now, celsius)

    def expect(self, law: TemperatureLaw, *, learnt: bool) -> None:
        """Use a temperature law from now on; its slope (rad/s/K) replaces the tracked one.

        learnt: True if the tracked slope was estimated under this law; the slope is then kept.
        """
        self.law = law
        self._filter.expect(law, learnt=learnt)

    def doubts(self, now: float) -> Sentences:
        """Reasons for a new doubt about the bias at device time `now`, s.

        Empty when there is none, or when the bias is already doubted.
        """
        return self.doubt.news(now - self._evidence_time, gravity=self._gravity_disagrees)

    def trusts(self) -> bool:
        """End the doubt about the bias if the rests since have resolved it; return True if it ended."""
        age_s = self.time - self._evidence_time
        return self.doubt.settled(age_s, sure=self.sure, gravity=self._gravity_disagrees)

    @property
    def _gravity_disagrees(self) -> bool:
        return self._accelerometer.contradicts and float(self._model.scale_std.max()) < SCALE_STD
