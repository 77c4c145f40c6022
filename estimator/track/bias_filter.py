"""A random-walk Kalman filter of the gyro's bias (the reading at zero rate), on filterpy.

Letters of the equations: x bias (3,) rad/s, P its covariance, z a measured bias, R its covariance, Q what the walk adds.
Knobs, state and receipts are apart: a filter built from saved state goes on as if it had never stopped.
"""

from dataclasses import dataclass
from math import radians

import numpy as np
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class BiasKnobs:
    """How the bias wanders. Rates in rad/s."""

    #: rate random walk, rad/s per root second: an in-run bias of a low-cost part
    rate_random_walk: float = radians(2e-3)
    #: how much the bias may move per kelvin
    per_kelvin: float = radians(0.03)
    #: largest normalised innovation squared (3 degrees of freedom) that is believed: false alarm 1e-6
    gate: float = 30.66


@dataclass(frozen=True, slots=True, eq=False)
class BiasState:
    """All that evolves: x (3,), P (3, 3), device time and temperature now, and the temperature of the last evidence."""

    x: Floats
    P: Floats
    time: float
    temperature_c: float = np.nan
    reference_c: float = np.nan
    #: how far, K, the temperature has been from that since
    farthest_k: float = 0.0

    @property
    def std(self) -> Floats:
        """(3,) standard deviation of the bias."""
        std: Floats = np.sqrt(np.diag(self.P))
        return std


@dataclass(frozen=True, slots=True, eq=False)
class Receipt:
    """What one piece of evidence did: innovation (3,) = measured - predicted, its covariance, test ratio = NIS / gate."""

    time: float
    kind: str
    innovation: Floats
    innovation_cov: Floats
    test_ratio: float
    accepted: bool
    reason: str = ""


class BiasFilter:
    """The filter at work; `state` may be copied at any time."""

    def __init__(self, state: BiasState, knobs: BiasKnobs | None = None) -> None:
        self.knobs = knobs or BiasKnobs()
        self._kf = KalmanFilter(dim_x=3, dim_z=3)
        self._kf.F = np.eye(3)
        self._kf.H = np.eye(3)
        self._kf.x = np.array(state.x, float)  # (3,): filterpy's own default is (3, 1)
        self._kf.P = np.array(state.P, float)
        self._time = state.time
        self._temperature_c = state.temperature_c
        self._farthest_k = state.farthest_k
        self._reference_c = state.reference_c if np.isfinite(state.reference_c) else state.temperature_c

    @property
    def state(self) -> BiasState:
        """The estimate as it is now."""
        return BiasState(
            self._kf.x.copy(), self._kf.P.copy(), self._time, self._temperature_c, self._reference_c, self._farthest_k
        )

    def predict(self, time: float, temperature_c: float = np.nan) -> None:
        """Let the bias walk to a device time; time that goes backward is ignored."""
        dt = time - self._time
        if not dt > 0:
            return
        q = self.knobs.rate_random_walk**2 * dt + self._warmed(temperature_c)
        self._kf.predict(Q=q * np.eye(3))
        self._time = time

    def _warmed(self, temperature_c: float) -> float:
        """The variance added by going farther from the temperature of the last evidence than ever since.

        The way there adds up in full, for the bias follows it; back and forth on it adds nothing.
        """
        if not np.isfinite(temperature_c):
            return 0.0
        if not np.isfinite(self._reference_c):
            self._reference_c = self._temperature_c = temperature_c
        self._temperature_c = temperature_c
        before = self._farthest_k
        self._farthest_k = max(before, abs(temperature_c - self._reference_c))
        return self.knobs.per_kelvin**2 * (self._farthest_k**2 - before**2)

    def update(self, kind: str, z: Floats, R: Floats, common_var: Floats | None = None) -> Receipt:
        """Weigh a measured bias z (3,) with covariance R (3, 3) against the estimate; take it if it is believable.

        common_var (3,): the part of R that is the same error in every measurement; no number of them gets below it.
        """
        innovation = z - self._kf.x
        S = self._kf.P + R
        # filterpy would turn all of x into NaN for ever, with P still looking perfect.
        if not (np.all(np.isfinite(innovation)) and np.all(np.isfinite(R)) and np.all(np.diag(R) > 0)):
            return Receipt(self._time, kind, innovation, S, np.inf, accepted=False, reason="not finite")
        ratio = float(innovation @ np.linalg.solve(S, innovation)) / self.knobs.gate
        if ratio > 1:
            return Receipt(self._time, kind, innovation, S, ratio, accepted=False, reason="outside the gate")
        self._kf.update(z, R=R)
        if common_var is not None:
            self._kf.P += np.diag(np.maximum(0.0, common_var - np.diag(self._kf.P)))
        self._reference_c, self._farthest_k = self._temperature_c, 0.0
        return Receipt(self._time, kind, innovation, S, ratio, accepted=True)

    def restart(self, z: Floats, R: Floats) -> None:
        """Begin again from a measured bias z (3,) with covariance R (3, 3): what was believed before no longer holds."""
        self._kf.x = np.array(z, float)
        self._kf.P = np.array(R, float)
        self._reference_c, self._farthest_k = self._temperature_c, 0.0
