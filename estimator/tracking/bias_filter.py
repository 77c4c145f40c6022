"""A Kalman filter of the gyro's bias (the reading at zero rate), on filterpy.

Letters of the equations: x the state, P its covariance, z a measurement with covariance R, H what it sees of the state, F how
the state goes on, Q what the walk adds. The state begins with the bias now, rad/s, and its slope by temperature, rad/s/K; an
evidence that needs more of its own (gravity.py) appends it. Knobs, state and receipts are apart: a filter built from saved state
goes on as if it had never stopped.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import exp, expm1, isfinite, isnan, radians
from threading import get_ident
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.kernels.bias_filter import inverse, walked, weighed
from estimator.state import StateStruct, shaped
from estimator.tracking.evidence import Evidence, Receipt
from estimator.tracking.random_walk import RandomWalks
from estimator.tracking.temperature_law import TemperatureLaw

Floats = NDArray[np.float64]

BIAS, SLOPE = slice(0, 3), slice(3, 6)
#: states of the filter itself
OWN = 6
_NOTHING = np.zeros(3)
#: what the noise of a measurement of now has in common with the error of the state
_UNCORRELATED = np.zeros((OWN, 0))
#: K, a slope changes by steps of temperature this long: in a second's own, squared and added up, next to nothing is left of
#: what it changes over hours, and a thermometer's noise would add up too
_BEND_K = 1.0


@dataclass(frozen=True, slots=True)
class BiasKnobs:
    """How the bias wanders. Rates in rad/s."""

    #: rate random walk at a constant temperature, rad/s per root second
    rate_random_walk: float = radians(8e-4)
    #: the same just after power-up, where no temperature tells of the warming, and how fast that fades, s: its own heat
    #: takes minutes, the skin of who wears it ten (tests/bench/warming.py)
    warm_up_walk: float = radians(3e-3)
    warm_up_s: float = 600.0
    #: how much the bias may move per kelvin, before that is learnt
    per_kelvin: float = radians(0.03)
    #: how much the slope itself may change per kelvin, rad/s/K²
    curvature: float = radians(0.001)
    #: standard deviation of what flickers about a mean of minutes. It is no state of the filter: a faster walk, to follow it,
    #: makes the bias better by 7 % at most, for the worst of the kinds that come with truerate
    flicker: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class BiasState:
    """All that evolves: x (n,), P (n, n), device time and temperature now, and when the device was powered up.

    The temperature is an average over the last while; the device is lag_k warmer than that.
    """

    x: Floats
    P: Floats
    time: float
    temperature_c: float = np.nan
    powered: float = -np.inf
    #: where the slope was last given way to change
    bent_c: float = np.nan
    lag_k: float = 0.0

    @property
    def bias(self) -> Floats:
        """(3,) the reading at zero rate, rad/s."""
        return self.x[BIAS]

    @property
    def bias_cov(self) -> Floats:
        """(3, 3) its covariance."""
        return self.P[BIAS, BIAS]

    @property
    def std(self) -> Floats:
        """(3,) standard deviation of the bias."""
        return np.asarray(np.sqrt(np.diag(self.P)[BIAS]))


def start(
    bias: Floats,
    cov: Floats,
    time: float,
    knobs: BiasKnobs,
    *,
    temperature_c: float = np.nan,
    powered: float = -np.inf,
) -> BiasState:
    """A state of the filter's own six from a bias (3,) with covariance (3, 3); the slope as parts are made."""
    P = np.zeros((OWN, OWN))
    P[BIAS, BIAS], P[SLOPE, SLOPE] = cov, knobs.per_kelvin**2 * np.eye(3)
    return BiasState(np.concatenate([bias, np.zeros(3)]), P, time, temperature_c, powered)


class FilterState(StateStruct):
    """now; unsure (3,): variance of the slope as the law had it; walks since what waits to be taken was measured."""

    now: BiasState
    unsure: Floats
    walks: RandomWalks


class Step(NamedTuple):
    """A step of the state x (n,) by F (n, n), with Q (n, n) added to its covariance."""

    x: Floats
    F: Floats
    Q: Floats


class BiasFilter:
    """The filter at work; `state` may be copied at any time."""

    def __init__(self, state: BiasState, knobs: BiasKnobs | None = None, law: TemperatureLaw | None = None) -> None:
        self.knobs = knobs or BiasKnobs()
        #: what earlier boots say of temperature; the slope of the state is believed as it is
        self.law = law
        #: (6,) what the law's curvature moved the state by in the last step, None without a law
        self.bent: Floats | None = None
        self.restart(state)

    def _take(self, state: BiasState) -> None:
        self._x, self._P = np.array(state.x, float), np.array(state.P, float)
        #: (3, 3) by how much the bias was doubted since the last step, if it was
        self.widened: Floats | None = None
        self.time, self.temperature_c, self._powered = state.time, state.temperature_c, state.powered
        self._bent_c = state.bent_c
        #: variance (3,) of the walk in the last step, and gain and H of what was taken in since
        self._walked, self._taken = _NOTHING, list[tuple[Floats, Floats]]()
        self._walks = RandomWalks.none(len(state.x))

    def restart(self, state: BiasState) -> None:
        """Forget all that came since, and go on from a state."""
        self._take(state)
        self._unsure = self._law_var(self.temperature_c)

    @property
    def saved(self) -> FilterState:
        """All that evolves from second to second."""
        return FilterState(self.state, self._unsure, self._walks)

    def resume(self, saved: FilterState, law: TemperatureLaw | None) -> None:
        """Go on from what was saved, under a law. Raises ValueError."""
        n = len(saved.now.x)
        shaped(saved.now.x, n, finite=True)
        shaped(saved.now.P, n, n, finite=True)
        shaped(saved.unsure, 3)
        saved.walks.check(n)
        if n < OWN or not isfinite(saved.now.time) or (np.diag(saved.now.P) < 0).any():
            raise ValueError("damaged state: no state of a bias filter")
        self.law = law
        self._take(saved.now)
        self._unsure, self._walks = saved.unsure, saved.walks

    def look_back(self, state: BiasState, time: float, temperature_c: float = np.nan) -> None:
        """What a state tells of the bias at a time before its own: a walk is as long backward as it is forward."""
        self.restart(state)
        self.predict(2 * state.time - time, temperature_c)
        self.time = time

    @property
    def x(self) -> Floats:
        """(n,) the state; not to be written to."""
        return self._x

    @property
    def cov(self) -> Floats:
        """(n, n) its covariance; not to be written to."""
        return self._P

    @property
    def state(self) -> BiasState:
        """The estimate as it is now."""
        return BiasState(self._x.copy(), self._P.copy(), self.time, self.temperature_c, self._powered, self._bent_c)

    def predict(self, time: float, temperature_c: float = np.nan, carried: Step | None = None) -> Step | None:
        """Let the bias walk to a device time, and all else go on as it is carried, which moves neither bias nor slope.

        carried: is written to, and returned with the walk. Time that goes backward is no time for a walk: None.
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
        self._walked = walked(step.x, step.F, step.Q, warmer, over, bend, var)
        self._step(step)
        self._taken.clear()
        if self.bent is not None:
            self._x[:OWN] += self.bent
        self.time, self.widened = time, None
        if known:
            first, self.temperature_c = isnan(self.temperature_c), temperature_c
            if first and self.law is not None:
                self.expect(self.law)
        return step

    def settle(self) -> None:
        """A second is over: leave nothing of rounding between both triangles of the covariance."""
        P = self._P + self._P.T
        P *= 0.5
        self._P = P

    def _step(self, step: Step) -> None:
        kf = self._filterpy()
        kf.predict(F=step.F, Q=step.Q)
        self._x, self._P = step.x.copy(), kf.P  # F is only the derivative of x
        if len(self._walks):
            self._walks.step(step.F, self._walked)

    def expect(self, law: TemperatureLaw) -> None:
        """From now on believe the slope of a law in place of what was known of it."""
        self.law = law
        if np.isfinite(self.temperature_c):
            self._x[SLOPE] = law.slope(self.temperature_c)
            self._unsure = self._law_var(self.temperature_c)
            P = self._P
            P[SLOPE, :] = P[:, SLOPE] = 0.0
            P[SLOPE, SLOPE] = np.diag(self._unsure)
            self._walks.cross[:, SLOPE] = 0.0

    def follow(self, law: TemperatureLaw) -> None:
        """From now on go on by a law that the slope, as it is known, was learnt under."""
        self.law = law
        self._unsure = self._law_var(self.temperature_c)

    def unlearn(self) -> Floats:
        """Give the law up: the slope is doubted as much as that of any part; by how much, (3, 3)."""
        self.law = None
        doubt = self.knobs.per_kelvin**2 * np.eye(3)
        self._P[SLOPE, SLOPE] += doubt
        return doubt

    @property
    def against_law(self) -> float:
        """How many standard deviations the evidence has moved the slope from where the law has it; the most of three axes."""
        if self.law is None or not np.isfinite(self.temperature_c):
            return 0.0
        moved = self._x[SLOPE] - self.law.slope(self.temperature_c)
        # Evidence leaves var - P of the law's own variance behind.
        told = np.maximum(self._unsure - np.diag(self._P)[SLOPE], self._unsure / 4)
        return float(np.max(np.abs(moved) / np.sqrt(told)))

    def _law_var(self, celsius: float) -> Floats:
        return np.zeros(3) if self.law is None or not np.isfinite(celsius) else self.law.slope_var(celsius)

    def _bend(self, warmer: float, temperature_c: float) -> tuple[Floats, float, Floats | None]:
        """(3,) by how much the slope may change, over how many kelvin; (6,) what the law knows of that."""
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
        """Variance that some seconds about now add to the bias; known: temperature tells of the warming, by default if one is."""
        known, knobs = isfinite(self.temperature_c) if known is None else known, self.knobs
        var = knobs.rate_random_walk**2 * dt
        if not known and isfinite(self._powered):
            fading = exp(-max(0.0, self.time - self._powered) / knobs.warm_up_s)
            var += knobs.warm_up_walk**2 * fading * -expm1(-dt / knobs.warm_up_s) * knobs.warm_up_s
        return var

    def widen(self, cov: Floats) -> None:
        """Doubt the bias by so much more, (3, 3)."""
        self._P[BIAS, BIAS] += cov
        self.widened = cov if self.widened is None else self.widened + cov

    def wait(self) -> None:
        """What was measured in the last step is to be taken later, by `take_first`."""
        self._walks.begin(self._walked, self._taken)

    @property
    def waiting(self) -> int:
        """How many measurements wait; none of what was measured before the state was begun anew does."""
        return len(self._walks)

    def forget(self) -> None:
        """What was measured before now and has not been taken will not be."""
        self._walks = RandomWalks.none(len(self._x))

    def extend(self, own: BiasState) -> None:
        """Go on with a state that has other parts behind the filter's own six."""
        self._take(own)

    def weigh(self, evidence: Evidence) -> Receipt:
        """What `update` would say of a measurement, which is not taken."""
        return self._receipt(evidence, evidence.H, evidence.R, _UNCORRELATED)

    def update_both(self, first: Evidence, then: Evidence) -> tuple[Receipt, Receipt]:
        """Take two measurements of now one after the other: in one step where both are believable."""
        m = len(first.z)
        z, H = np.concatenate([first.z, then.z]), np.concatenate([first.H, then.H])
        R = np.zeros((len(z), len(z)))
        R[:m, :m], R[m:, m:] = first.R, then.R
        y, S, before, nis = weighed(z, H, R, self._x, self._P, _UNCORRELATED, m)
        said = self._said(first, y[:m], S[:m, :m], before), self._said(then, y[m:], S[m:, m:], nis)
        if not (said[0].accepted and said[1].accepted and first.common_var is None):
            return self.update(first), self.update(then)
        self._take_now(z, H, R)
        self._doubt_common(then)
        return said

    def update(self, evidence: Evidence) -> Receipt:
        """Take a measurement of now by filterpy, where it is believable."""
        receipt = self.weigh(evidence)
        if receipt.accepted or (evidence.soft and isfinite(receipt.nis)):
            R = evidence.R
            if not receipt.accepted:
                # What is seen is then just within the gate, whatever makes it unlikely: the state may be the wrong one.
                R = R + (receipt.test_ratio - 1) * receipt.innovation_cov
                receipt = receipt._replace(accepted=True, reason="")
            self._take_now(evidence.z, evidence.H, R)
            self._doubt_common(evidence)
        return receipt

    def _take_now(self, z: Floats, H: Floats, R: Floats) -> None:
        kf = self._filterpy()
        kf.update(z, R=R, H=H)
        self._x, self._P = kf.x, kf.P
        self._taken.append((kf.K, H))
        if len(self._walks):
            self._walks.taken(kf.K, H)

    def take_first(self, evidence: Evidence) -> Receipt:
        """Take the measurement that has waited longest, where it is believable; the bias has walked on since."""
        H, noise, M = self._walks.sight(evidence.H)
        R, K = evidence.R + noise, np.zeros(M.shape)
        receipt = self._receipt(evidence, H, R, M)
        if receipt.accepted:
            kf = self._filterpy()
            kf.M = M
            kf.update_correlated(evidence.z, R=R, H=H)
            self._x, self._P, K = kf.x, kf.P, kf.K
            self._doubt_common(evidence)
        self._walks.first_taken(K, H)
        return receipt

    def _filterpy(self) -> Any:
        kf = _filter(len(self._x), get_ident())
        kf.x, kf.P = self._x, self._P
        return kf

    def _doubt_common(self, evidence: Evidence) -> None:
        """In doubt stays what is the same error in all measurements of a kind: no number of them tells of it."""
        if evidence.common_var is not None and any(evidence.common_var.tolist()):
            H, P = evidence.H, self._P
            seen = ((H @ P) * H).sum(axis=1)
            self._P = P + H.T @ np.diag(np.maximum(0.0, evidence.common_var - seen)) @ H

    def _receipt(self, evidence: Evidence, H: Floats, R: Floats, M: Floats) -> Receipt:
        innovation, cov, _, nis = weighed(evidence.z, H, R, self._x, self._P, M, 0)
        return self._said(evidence, innovation, cov, nis)

    def _said(self, evidence: Evidence, innovation: Floats, cov: Floats, nis: float) -> Receipt:
        """What is not finite, or claims to be without noise, never gets to filterpy: x would be NaN for ever, P look perfect."""
        ratio = nis / evidence.gate
        reason = "not finite" if not isfinite(nis) else "outside the gate" if ratio > 1 else ""
        return Receipt(self.time, evidence.kind, innovation, cov, ratio, not reason, reason, nis)


@lru_cache(maxsize=16)
def _filter(n: int, thread: int) -> Any:  # noqa: ARG001 - no two threads use one at the same time
    """One of n states, for all devices: what filterpy keeps beside x and P would push a thousand of them out of a CPU's cache."""
    from filterpy.kalman import KalmanFilter  # noqa: PLC0415 - it brings SciPy and Matplotlib: a second for every command

    kf = KalmanFilter(dim_x=n, dim_z=3)
    kf.inv = inverse
    return kf


def _stays(x: Floats) -> Step:
    return Step(x.copy(), np.eye(len(x)), np.zeros((len(x), len(x))))
