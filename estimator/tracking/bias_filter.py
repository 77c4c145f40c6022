"""Kalman filter of the gyro's bias (the reading at zero rate), built on filterpy.

Letters of the equations:

    x   state (n,): present bias (3) rad/s, its slope by temperature (3) rad/s/K, then appended states
    P   covariance of x (n, n), in squares of the units of x
    z   measurement (m,) with covariance R (m, m) and observation matrix H (m, n)
    F   transition matrix (n, n)
    Q   process noise (n, n)

The gravity evidence (gravity.py) appends its states. Settings, state and receipts are separate objects: a filter built
from a saved state continues without a difference.
"""

from functools import lru_cache
from math import isfinite, isnan
from threading import get_ident
from typing import Any, NamedTuple

import numpy as np

from estimator.kernels.bias_filter import inverse, walked, weighed
from estimator.state import Floats, StateStruct, shaped
from estimator.tracking.bias_state import BIAS, OWN, SLOPE, BiasKnobs, BiasState
from estimator.tracking.evidence import Evidence, Receipt
from estimator.tracking.temperature_law import TemperatureLaw

_NOTHING = np.zeros(3)
#: variances of the bias, in a covariance
_DIAGONAL = range(3), range(3)
#: K; the slope may change only after temperature has moved this far. Per second the changes, squared and added, would sum to
#: next to nothing over hours, and a thermometer's noise would add up too.
_BEND_K = 1.0


class FilterState(StateStruct):
    """Saved state of a bias filter.

    now: state of the filter: bias (rad/s), slope by temperature (rad/s/K), appended states, and their covariance.
    unsure (3,): variance of the slope that the temperature law alone gives, without this boot's evidence, (rad/s/K)².
    """

    now: BiasState
    unsure: Floats


class Step(NamedTuple):
    """Prediction step of the filter: predicted state x (n,), transition matrix F (n, n), process noise Q (n, n).

    Units are those of the state: rad/s for the bias, rad/s/K for its slope.
    """

    x: Floats
    F: Floats
    Q: Floats


class BiasFilter:
    """Kalman filter of bias (3) rad/s and its slope by temperature (3) rad/s/K; `state` may be copied at any time.

    state: initial state. knobs: process noise; None uses the defaults.
    law: temperature law from earlier boots, or None.
    """

    def __init__(self, state: BiasState, knobs: BiasKnobs | None = None, law: TemperatureLaw | None = None) -> None:
        self.knobs = knobs or BiasKnobs()
        #: temperature law of earlier boots; the slope in the state is used as it is
        self.law = law
        #: (6,) change of the state by the law's curvature in the last step; None without a law
        self.bent: Floats | None = None
        #: factor of the random walk's variance in this boot
        self.pace = 1.0
        self.restart(state)

    def _take(self, state: BiasState) -> None:
        self._x, self._P = np.array(state.x, float), np.array(state.P, float)
        #: (3, 3) covariance added by `widen` since the last step, or None
        self.widened: Floats | None = None
        self.time, self.temperature_c, self._powered = state.time, state.temperature_c, state.powered
        self._bent_c = state.bent_c

    def restart(self, state: BiasState) -> None:
        """Discard the present state and continue from `state`."""
        self._take(state)
        self._unsure = self._law_var(self.temperature_c)

    @property
    def saved(self) -> FilterState:
        """State to save for `resume`: all values that updates and predictions change."""
        return FilterState(self.state, self._unsure)

    def resume(self, saved: FilterState, law: TemperatureLaw | None) -> None:
        """Restore a state saved by `saved`.

        law: temperature law from then on, or None.
        Raises ValueError when the state is damaged: wrong shapes, values that are not finite, or negative variances.
        """
        n = len(saved.now.x)
        shaped(saved.now.x, n, finite=True)
        shaped(saved.now.P, n, n, finite=True)
        shaped(saved.unsure, 3)
        if n < OWN or not isfinite(saved.now.time) or (np.diag(saved.now.P) < 0).any():
            raise ValueError("damaged state: the data is not of a bias filter; start without this state")
        self.law = law
        self._take(saved.now)
        self._unsure = saved.unsure

    def look_back(self, state: BiasState, time: float, temperature_c: float = np.nan) -> None:
        """Restart the filter from `state`, predicted backward to an earlier device time `time`, s.

        The random walk adds the same variance (rad/s)² backward as forward.
        temperature_c: temperature at that time, °C; NaN when unknown.
        """
        self.restart(state)
        self.predict(2 * state.time - time, temperature_c)
        self.time = time

    @property
    def x(self) -> Floats:
        """Current state (n,): bias (3) rad/s, slope (3) rad/s/K, then the appended states; read only."""
        return self._x

    @property
    def cov(self) -> Floats:
        """Covariance (n, n) of the current state, in squares of the units of `x`; read only."""
        return self._P

    @property
    def state(self) -> BiasState:
        """Copy of the current state: x, its covariance, device time, s, and temperature, °C."""
        return BiasState(self._x.copy(), self._P.copy(), self.time, self.temperature_c, self._powered, self._bent_c)

    def predict(self, time: float, temperature_c: float = np.nan, carried: Step | None = None) -> Step | None:
        """Predict the state to a device time, s: the bias follows temperature, and its variance grows by a random walk.

        temperature_c: temperature at that time, °C; NaN when unknown.
        carried: prediction step of the appended states, in which bias and slope do not change. The method adds their
            changes to this step in place. None leaves the appended states unchanged.
        Returns the complete step. Returns None when time does not advance.
        """
        dt, known = time - self.time, isfinite(temperature_c)
        step = _stays(self._x) if carried is None else carried
        if not dt > 0:
            if carried is not None:
                self._step(step)
            return None
        warmer = temperature_c - self.temperature_c
        if isfinite(warmer):
            bend, over, self.bent = self._bend(warmer, temperature_c)
        else:
            warmer, bend, over, self.bent = 0.0, _NOTHING, 0.0, None
        var = self.walked(dt, known=known)
        walked(step.x, step.F, step.Q, warmer, over, bend, var)
        self._step(step)
        if self.bent is not None:
            self._x[:OWN] += self.bent
        self.time, self.widened = time, None
        if known:
            first, self.temperature_c = isnan(self.temperature_c), temperature_c
            if first and self.law is not None:
                self.expect(self.law)
        return step

    def settle(self) -> None:
        """Make the covariance exactly symmetric again after rounding errors; call once a second."""
        P = self._P + self._P.T
        P *= 0.5
        self._P = P

    def _step(self, step: Step) -> None:
        kf = self._filterpy()
        kf.predict(F=step.F, Q=step.Q)
        self._x, self._P = step.x.copy(), kf.P  # x itself from step.x: F is only its derivative

    def expect(self, law: TemperatureLaw, *, learnt: bool = False) -> None:
        """Use a temperature law from now on; its slope (rad/s/K) and variance replace those in the filter's state.

        learnt: True if the filter's slope was estimated under this law; the slope is then kept.
        """
        self.law, self._unsure = (
            law,
            law.slope_var(self.temperature_c) if np.isfinite(self.temperature_c) else np.zeros(3),
        )
        if np.isfinite(self.temperature_c) and not learnt:
            self._x[SLOPE] = law.slope(self.temperature_c)
            P = self._P
            P[SLOPE, :] = P[:, SLOPE] = 0.0
            P[SLOPE, SLOPE] = np.diag(self._unsure)

    def unlearn(self) -> Floats:
        """Give up the temperature law, and add the prior variance of the slope to that of the tracked slope.

        Returns the added covariance (3, 3), (rad/s/K)².
        """
        self.law = None
        doubt = self.knobs.per_kelvin**2 * np.eye(3)
        self._P[SLOPE, SLOPE] += doubt
        return doubt

    @property
    def against_law(self) -> float:
        """Difference between the filter's slope and the law's slope, in standard deviations; the largest of three axes.

        The variance of the difference is that of the law minus that in the filter, and at least a quarter of that of
        the law. The result is 0 without a law or without a temperature.
        """
        if self.law is None or not np.isfinite(self.temperature_c):
            return 0.0
        moved = self._x[SLOPE] - self.law.slope(self.temperature_c)
        # Evidence has reduced the law's variance to P: the difference is what the evidence told.
        told = np.maximum(self._unsure - np.diag(self._P)[SLOPE], self._unsure / 4)
        return float(np.max(np.abs(moved) / np.sqrt(told)))

    def _law_var(self, celsius: float) -> Floats:
        return np.zeros(3) if self.law is None or not np.isfinite(celsius) else self.law.slope_var(celsius)

    def _bend(self, warmer: float, temperature_c: float) -> tuple[Floats, float, Floats | None]:
        """(3,) how much the slope may change, over how many kelvin; (6,) the change that the law predicts, or None."""
        if self.law is None:
            over = temperature_c - (self._bent_c if isfinite(self._bent_c) else self.temperature_c)
            if abs(over) < _BEND_K:
                self._bent_c = temperature_c - over
                return _NOTHING, 0.0, None
            self._bent_c = temperature_c
            return np.full(3, self.knobs.curvature * over), over, None
        self._bent_c = temperature_c
        by = self.law.quadratic * warmer
        before, self._unsure = self._unsure, np.maximum(self._unsure, self._law_var(temperature_c))
        return np.sqrt(self._unsure - before), warmer, np.concatenate([by * warmer, 2 * by])

    def walked(self, dt: float, *, known: bool | None = None) -> float:
        """Variance per axis, (rad/s)², that the random walk adds to the bias in dt seconds.

        known: True if the temperature is known, so that warming up adds nothing to the walk. False adds the warm-up
            walk. By default True once a temperature was read.
        """
        known, knobs = isfinite(self.temperature_c) if known is None else known, self.knobs
        var = knobs.rate_random_walk**2 * self.pace * dt
        if not known and isfinite(self._powered):
            var += knobs.warmed(self.time - self._powered, dt)
        return var

    def widen(self, cov: Floats) -> None:
        """Add a covariance (3, 3), (rad/s)², to that of the bias."""
        self._P[BIAS, BIAS] += cov
        self.widened = cov if self.widened is None else self.widened + cov

    def extend(self, own: BiasState) -> None:
        """Replace the filter's state and covariance by those of `own`, which has states appended for the gravity evidence.

        own: x begins with the filter's six states: bias (3) rad/s and its slope by temperature (3) rad/s/K. The
            appended states follow; gravity.py lists them. Time and temperature are taken from `own` too.
        """
        self._take(own)

    def weigh(self, evidence: Evidence) -> Receipt:
        """Compute the receipt of a measurement without changing the filter.

        `accepted` is True if the NIS passes the gate.
        """
        innovation, cov, _, nis = weighed(evidence.z, evidence.H, evidence.R, self._x, self._P, 0)
        return self._said(evidence, innovation, cov, nis)

    def update_both(self, first: Evidence, then: Evidence) -> tuple[Receipt, Receipt]:
        """Update with two measurements of the same time, and return both receipts in the same order.

        Both are applied in one joint update if both pass their gates and `first.common_var` is None. Otherwise `update`
        applies one after the other.
        """
        m = len(first.z)
        z, H = np.concatenate([first.z, then.z]), np.concatenate([first.H, then.H])
        R = np.zeros((len(z), len(z)))
        R[:m, :m], R[m:, m:] = first.R, then.R
        y, S, before, nis = weighed(z, H, R, self._x, self._P, m)
        said = self._said(first, y[:m], S[:m, :m], before), self._said(then, y[m:], S[m:, m:], nis)
        if not (said[0].accepted and said[1].accepted and first.common_var is None):
            return self.update(first), self.update(then)
        self._take_now(z, H, R)
        self._doubt_common(then)
        return said

    def update(self, evidence: Evidence) -> Receipt:
        """Update with a measurement of the present state if its NIS passes its gate; return the receipt.

        A measurement with `Evidence.soft` is always applied if its NIS is finite. Beyond the gate its R is enlarged
        until the NIS just passes.
        """
        receipt = self.weigh(evidence)
        if receipt.accepted or (evidence.soft and isfinite(receipt.nis)):
            R = evidence.R
            if not receipt.accepted:
                # Soft evidence is weighted to just pass its gate, whatever makes it unlikely: the state may be wrong.
                R = R + (receipt.test_ratio - 1) * receipt.innovation_cov
                receipt = receipt._replace(accepted=True, reason="")
            self._take_now(evidence.z, evidence.H, R)
            self._doubt_common(evidence)
        return receipt

    def _take_now(self, z: Floats, H: Floats, R: Floats) -> None:
        kf = self._filterpy()
        kf.update(z, R=R, H=H)
        self._x, self._P = kf.x, kf.P

    def update_late(self, evidence: Evidence, time: float, celsius: float) -> Receipt:
        """Update with a measurement of the bias at an earlier time, if its NIS passes its gate; return the receipt.

        time: device time of the measurement, s. celsius: temperature at that time, °C; NaN when unknown.
        Method: the measurement is treated as one of the present bias, with the random walk since `time` as additional
        noise. This noise is correlated with the error of the present state, with cross-covariance M (n, m) in (rad/s)².
        The information that updates since `time` gave on the walk is neglected.
        """
        m, n, walk = len(evidence.z), len(self._x), self.walked(self.time - time)
        H, M, then = np.zeros((m, n)), np.zeros((n, m)), self._P.copy()
        H[:, BIAS] = axes = evidence.H[:, BIAS]
        if isfinite(warmer := self.temperature_c - celsius):
            H[:, SLOPE] = -warmer * axes
        M[BIAS] = -walk * axes.T
        then[_DIAGONAL] -= walk
        innovation, cov, _, nis = weighed(evidence.z, H, evidence.R, self._x, then, 0)
        receipt = self._said(evidence, innovation, cov, nis)
        if receipt.accepted:
            kf = self._filterpy()
            kf.M = M
            kf.update_correlated(evidence.z, R=evidence.R + walk * (axes @ axes.T), H=H)
            self._x, self._P = kf.x, kf.P
            self._doubt_common(evidence)
        return receipt

    def _filterpy(self) -> Any:
        kf = _filter(len(self._x), get_ident())
        kf.x, kf.P = self._x, self._P
        return kf

    def _doubt_common(self, evidence: Evidence) -> None:
        """Keep the variance of an error common to all measurements: no number of them can reduce it."""
        if evidence.common_var is not None and any(evidence.common_var.tolist()):
            H, P = evidence.H, self._P
            seen = ((H @ P) * H).sum(axis=1)
            self._P = P + H.T @ np.diag(np.maximum(0.0, evidence.common_var - seen)) @ H

    def _said(self, evidence: Evidence, innovation: Floats, cov: Floats, nis: float) -> Receipt:
        """Build a receipt. Values that are not finite never reach filterpy: x would be NaN for ever, P look perfect."""
        ratio = nis / evidence.gate
        reason = "not finite" if not isfinite(nis) else "outside the gate" if ratio > 1 else ""
        return Receipt(self.time, evidence.kind, innovation, cov, ratio, not reason, reason, nis)


@lru_cache(maxsize=16)
def _filter(n: int, thread: int) -> Any:  # noqa: ARG001 - no two threads use one at the same time
    """Shared filterpy filter of n states: one for each of a thousand devices would not fit into a CPU's cache."""
    from filterpy.kalman import KalmanFilter  # noqa: PLC0415 - it brings SciPy and Matplotlib: a second for every command

    kf = KalmanFilter(dim_x=n, dim_z=3)
    kf.inv = inverse
    return kf


def _stays(x: Floats) -> Step:
    return Step(x.copy(), np.eye(len(x)), np.zeros((len(x), len(x))))
