"""A Kalman filter of the gyro's bias (the reading at zero rate), on filterpy.

Letters of the equations: x the state, P its covariance, z a measurement with covariance R, H what it sees of the state, F how
the state goes on, Q what the walk adds. The state begins with the bias now, rad/s, and its slope by temperature, rad/s/K; an
evidence that needs more of its own (gravity.py) appends it. Knobs, state and receipts are apart: a filter built from saved state
goes on as if it had never stopped.
"""

from dataclasses import dataclass
from functools import cache
from math import exp, expm1, inf, isfinite, isnan, radians

import numpy as np
from numpy.typing import NDArray

from estimator.loops.gravity import wandered
from estimator.loops.weigh import inverse, stacked, weighed
from estimator.track.evidence import Evidence, Receipt
from estimator.track.kalman import Bare
from estimator.track.since import NOW, Since
from estimator.track.temperature import TemperatureLaw

Floats = NDArray[np.float64]

BIAS, SLOPE = slice(0, 3), slice(3, 6)
#: states of the filter itself
OWN = 6
_NOTHING, _NO_WALK = np.zeros(3), np.zeros((3, 3))
#: a gain, what it was taken in by, and the moment it was measured if that was late: see Since.taken
_Taken = tuple[Floats, Floats, Since | None]
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


class BiasFilter:
    """The filter at work; `state` may be copied at any time."""

    def __init__(self, state: BiasState, knobs: BiasKnobs | None = None, law: TemperatureLaw | None = None) -> None:
        self.knobs = knobs or BiasKnobs()
        #: what earlier boots say of temperature; the slope of the state is believed as it is
        self.law = law
        #: (6,) what the law's curvature moved the state by in the last step, None without a law
        self.bent: Floats | None = None
        self._since: list[Since] = []
        self.restart(state)

    def _take(self, state: BiasState) -> None:
        n = len(state.x)
        self._kf = Bare(n)
        self._kf.inv = inverse
        self._kf.x = np.array(state.x, float)  # (n,): filterpy's own default is (n, 1)
        self._kf.P = np.array(state.P, float)
        #: (3, 3) by how much the bias was doubted since the last step, if it was
        self.widened: Floats | None = None
        self.time, self.temperature_c, self._powered = state.time, state.temperature_c, state.powered
        self._bent_c = state.bent_c
        #: variance (3, 3) of the walk in the last step, and what was taken in since: most steps nothing is taken of later
        self._walked, self._taken = _NO_WALK, list[_Taken]()
        self._stepped: Since | None = None  # the walk since what was measured in the last step, once somebody asked
        self._since.clear()

    def restart(self, state: BiasState) -> None:
        """Forget all that came since, and go on from a state."""
        self._take(state)
        self._unsure = self._law_var(self.temperature_c)

    def look_back(self, state: BiasState, time: float, temperature_c: float = np.nan) -> None:
        """What a state tells of the bias at a time before its own: a walk is as long backward as it is forward."""
        self.restart(state)
        self.predict(2 * state.time - time, temperature_c)
        self.time = time

    @property
    def x(self) -> Floats:
        """(n,) the state; not to be written to."""
        x: Floats = self._kf.x
        return x

    @property
    def cov(self) -> Floats:
        """(n, n) its covariance; not to be written to."""
        P: Floats = self._kf.P
        return P

    @property
    def state(self) -> BiasState:
        """The estimate as it is now."""
        return BiasState(
            self._kf.x.copy(), self._kf.P.copy(), self.time, self.temperature_c, self._powered, self._bent_c
        )

    def predict(self, time: float, temperature_c: float = np.nan, carried: Floats | None = None) -> Floats | None:
        """Let the bias walk to a device time, and all else go on as it is carried, which moves neither bias nor slope.

        carried (2 n + 1, n): the state it goes on to, by which F, with which Q added, one above the other; is written to, and is
        what it comes to with the walk. Time that goes backward is no time for a walk: None.
        """
        dt, n = time - self.time, len(self._kf.x)
        known = isfinite(temperature_c)
        rows = _stays(n).copy() if carried is None else carried
        if not dt > 0:
            if carried is not None:
                self._step(rows, moved=True)
            return None
        warmer = temperature_c - self.temperature_c
        if isfinite(warmer):
            bend, over, self.bent = self._bend(warmer, temperature_c)
        else:
            warmer, bend, over, self.bent = 0.0, _NOTHING, 0.0, None
        wandered(rows, warmer, self.walked(dt, known=known), bend, over)
        self._step(rows, moved=carried is not None)
        self._walked, self._stepped = rows[n + 1 : n + 4, BIAS].copy(), None
        self._taken.clear()
        if self.bent is not None:
            self._kf.x[:OWN] += self.bent
        self.time, self.widened = time, None
        if known:
            first, self.temperature_c = isnan(self.temperature_c), temperature_c
            if first and self.law is not None:
                self.expect(self.law)
        return rows

    def _step(self, rows: Floats, *, moved: bool) -> None:
        n = rows.shape[1]
        F, Q = rows[1 : n + 1], rows[n + 1 :]
        self._kf.Q = Q  # handed over filterpy would look whether it is a number
        self._kf.predict(F=F)
        self._kf.let_go()
        if moved:
            self._kf.x = rows[0]
        for since in self._since:
            since.step(F, Q)

    def expect(self, law: TemperatureLaw) -> None:
        """From now on believe the slope of a law in place of what was known of it."""
        self.law = law
        if np.isfinite(self.temperature_c):
            self._kf.x[SLOPE] = law.slope(self.temperature_c)
            self._unsure = self._law_var(self.temperature_c)
            P = self._kf.P
            P[SLOPE, :] = P[:, SLOPE] = 0.0
            P[SLOPE, SLOPE] = np.diag(self._unsure)
            for since in {self._latest(), *self._since}:
                since.cross[SLOPE] = 0.0

    def follow(self, law: TemperatureLaw) -> None:
        """From now on go on by a law that the slope, as it is known, was learnt under."""
        self.law = law
        self._unsure = self._law_var(self.temperature_c)

    def unlearn(self) -> Floats:
        """Give the law up: the slope is doubted as much as that of any part; by how much, (3, 3)."""
        self.law = None
        doubt = self.knobs.per_kelvin**2 * np.eye(3)
        self._kf.P[SLOPE, SLOPE] += doubt
        return doubt

    @property
    def against_law(self) -> float:
        """How many standard deviations the evidence has moved the slope from where the law has it; the most of three axes."""
        if self.law is None or not np.isfinite(self.temperature_c):
            return 0.0
        moved = self._kf.x[SLOPE] - self.law.slope(self.temperature_c)
        # Evidence leaves var - P of the law's own variance behind.
        told = np.maximum(self._unsure - np.diag(self._kf.P)[SLOPE], self._unsure / 4)
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
        self._kf.P[BIAS, BIAS] += cov
        self.widened = cov if self.widened is None else self.widened + cov

    def since(self) -> Since:
        """The moment of what was measured in the last step, for what is to be taken later."""
        latest = self._latest()
        if latest not in self._since:
            self._since = [*self._since, latest]
        return latest

    def _latest(self) -> Since:
        if self._stepped is None:
            self._stepped = Since(len(self._kf.x), self._walked)
            for taken in self._taken:
                self._stepped.taken(*taken)
        return self._stepped

    def remembers(self, evidence: Evidence) -> bool:
        """Whether the state goes on from when this was measured: it was not begun anew since."""
        return evidence.since is None or evidence.since in self._since

    def forget(self) -> None:
        """What was measured before now and has not been taken will not be."""
        self._since.clear()

    def extend(self, own: BiasState) -> None:
        """Go on with a state that has other parts behind the filter's own six."""
        self._take(own)

    def weigh(self, evidence: Evidence) -> Receipt:
        """What `update` would say of a measurement, which is not taken."""
        kind, z, H, R, gate, _, _, since = evidence
        rows, nis, _ = weighed(z, H, R, self._kf.x, self._kf.P, NOW if since is None else since.rows, 0)
        return self._receipt(kind, rows[:, 0], rows[:, 1:], nis, gate)

    def _receipt(self, kind: str, innovation: Floats, cov: Floats, nis: float, gate: float) -> Receipt:
        # filterpy would turn all of x into NaN for ever, with P still looking perfect.
        finite = isfinite(nis)
        nis = nis if finite else inf
        ratio = nis / gate
        reason = "not finite" if not finite else "outside the gate" if ratio > 1 else ""
        return Receipt(self.time, kind, innovation, cov, ratio, not reason, reason, nis)

    def update(self, evidence: Evidence, weighed: Receipt | None = None) -> Receipt:
        """Weigh a measurement against the estimate, unless it was weighed just now; take it if it is believable."""
        receipt = weighed or self.weigh(evidence)
        R = evidence.R
        if not receipt.accepted:
            if not evidence.soft or not isfinite(receipt.nis):
                return receipt
            # What is seen is then just within the gate, whatever makes it unlikely: the state may be the wrong one.
            R = R + (receipt.test_ratio - 1) * receipt.innovation_cov
        self._take_in(evidence.z, evidence.H, R, evidence.since)
        self._leave(evidence)
        return receipt if receipt.accepted else receipt._replace(accepted=True, reason="")

    def update_both(self, first: Evidence, then: Evidence) -> tuple[Receipt, Receipt] | None:
        """Take two measurements of now, the first without common_var, as one after the other, which is one step.

        None, and neither is taken, where one is not believable.
        """
        rows, m, n = stacked(*first[1:4], *then[1:4]), len(first.z), len(self._kf.x)
        z, H, R = rows[:, -1], rows[:, :n], rows[:, n:-1]
        said, nis, first_nis = weighed(z, H, R, self._kf.x, self._kf.P, NOW, m)
        receipts = (
            self._receipt(first.kind, said[:m, 0], said[:m, 1 : m + 1], first_nis, first.gate),
            self._receipt(then.kind, said[m:, 0], said[m:, m + 1 :], nis, then.gate),
        )
        if not (receipts[0].accepted and receipts[1].accepted):
            return None
        self._take_in(z, H, R, None)
        self._leave(then)
        return receipts

    def _leave(self, evidence: Evidence) -> None:
        """In doubt what is the same error in all measurements of a kind: no number of them tells of it."""
        if evidence.common_var is not None and any(evidence.common_var.tolist()):
            H = evidence.H
            seen = ((H @ self._kf.P) * H).sum(axis=1)
            self._kf.P += H.T @ np.diag(np.maximum(0.0, evidence.common_var - seen)) @ H

    def _take_in(self, z: Floats, H: Floats, R: Floats, late: Since | None) -> None:
        kf = self._kf
        if late is None:
            kf.R = R  # as Q
            kf.update(z, H=H)
        else:
            H, noise, kf.M = late.sight(H)
            kf.R = R + noise
            kf.update_correlated(z, H=H)
            kf.P = (kf.P + kf.P.T) / 2
            self._since = [since for since in self._since if since is not late]
        kf.let_go()
        taken = kf.K, H, late
        if self._stepped is None:
            self._taken.append(taken)
        elif self._stepped is not late and self._stepped not in self._since:
            self._stepped.taken(*taken)
        for since in self._since:
            if since is not late:
                since.taken(*taken)


@cache
def _stays(n: int) -> Floats:
    """(2 n + 1, n) what is carried nowhere; not to be written to."""
    return np.eye(2 * n + 1, n, -1)
