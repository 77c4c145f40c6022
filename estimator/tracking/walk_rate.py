"""Estimate of the rate random walk of this boot's bias, from its own rests.

A bank of scalar Kalman filters runs beside the bias filter: one for each axis and each hypothesis. A hypothesis is the
model's rate random walk times a factor. The mean readings of rests give each hypothesis its likelihood. The factor in
use is the mean of all factors on a logarithmic scale, weighted by probability.
All hypotheses expect the same warm-up drift, because rests of minutes do not show that warming up has ended.
Source: multiple-model estimation, D. T. Magill, "Optimal adaptive estimation of sampled stochastic processes", IEEE
Trans. Automatic Control 10 (1965).
"""

from math import isnan, radians

import msgspec
import numpy as np

from estimator.state import Floats, StateStruct, shaped
from estimator.tracking.bias_state import SLOPE, BiasKnobs, BiasState
from estimator.tracking.seconds import Second

#: s, tolerance when the end of a second is compared with the start of the next
_SAME_S = 1e-3
#: hypotheses: squared factors of the model's rate random walk, and their prior log weights
_FACTORS, _PRIOR = np.array([0.5, 1.0, 2.0, 4.0, 8.0]) ** 2, np.log([3.0, 8.0, 4.0, 1.5, 0.5])
#: seconds of rest in a row whose mean is one measurement
_BLOCK = 5
#: rad/s, error of such a mean beside its noise
_FLOOR = radians(0.001)
#: largest squared innovation in units of its variance: a jump is no walk
_MOST = 12.0
#: share of what was learnt that each measurement leaves
_KEPT = 0.99
_N = len(_FACTORS)


class WalkRate(StateStruct):
    """Bank of h hypotheses of one boot's rate random walk: takes rests, and gives `pace`, a factor on the walk's variance.

    told (h,): log-likelihood of each hypothesis.
    x (h, 3), P (h, 3): mean of the bias, rad/s, and its variance, (rad/s)², under each hypothesis.
    time, celsius: device time (s) and temperature (°C) of the last measurement.
    block: one-second blocks of rest, at most four, that wait for the fifth. Each is a tuple of end (device time, s),
        mean (3,) rad/s, its variance (3,) (rad/s)², and temperature (°C).
    Raises ValueError for arrays of wrong shape.
    """

    told: Floats = msgspec.field(default_factory=lambda: np.zeros(_N))
    x: Floats = msgspec.field(default_factory=lambda: np.zeros((_N, 3)))
    P: Floats = msgspec.field(default_factory=lambda: np.zeros((_N, 3)))
    time: float = float("nan")
    celsius: float = float("nan")
    block: list[tuple[float, Floats, Floats, float]] = msgspec.field(default_factory=list)

    def __post_init__(self) -> None:
        shaped(self.told, _N, finite=True)
        shaped(self.x, _N, 3, finite=True)
        shaped(self.P, _N, 3, finite=True)
        for _, mean, var, _ in self.block:
            shaped(mean, 3, finite=True)
            shaped(var, 3, finite=True)

    def take(self, second: Second, bias: BiasState, knobs: BiasKnobs, powered: float) -> bool:
        """Add a one-second block of rest; every five in a row give one measurement of the bias, their mean.

        bias: state of the bias filter at the end of the block. knobs: settings of the filter.
        powered: device time of power-up, s. With -inf (unknown), no warm-up drift is expected.
        Returns True if a measurement was made, so that `pace` has changed.
        """
        block = self.block
        if block and second.start - block[-1][0] > _SAME_S:
            block.clear()
        block.append((second.end, second.mean, second.mean_var, bias.temperature_c))
        n = len(block)
        if n < _BLOCK:
            return False
        means, variances = (np.array(column) for column in list(zip(*block, strict=True))[1:3])
        # What breathing moves shows in the scatter.
        R = np.maximum(variances.mean(axis=0), means.var(axis=0, ddof=1)) / n + _FLOOR**2
        self._measured(block[n // 2][0], means.mean(axis=0), R, bias, knobs, powered)
        block.clear()
        return True

    def _measured(self, time: float, z: Floats, R: Floats, bias: BiasState, knobs: BiasKnobs, powered: float) -> None:
        dt, warmer = time - self.time, bias.temperature_c - self.celsius
        if dt > 0:
            walked = knobs.rate_random_walk**2 * dt * _FACTORS
            if isnan(warmer):
                warmer = 0.0
                walked += knobs.warmed(self.time - powered, dt)
            P = self.P + walked[:, None] + warmer**2 * bias.P.diagonal()[SLOPE]
            S, off = P + R, z - self.x - warmer * bias.x[SLOPE]
            told = -0.5 * (np.log(S) + np.minimum(off**2 / S, _MOST)).sum(axis=1)
            self.told = _KEPT * self.told + (told - told.max())
            self.x, self.P = z - (1 - P / S) * off, P * (1 - P / S)
        else:  # the first one
            self.x, self.P = np.tile(z, (_N, 1)), np.tile(R, (_N, 1))
        self.time, self.celsius = time, bias.temperature_c

    @property
    def pace(self) -> float:
        """Factor, no unit, by which the variance of the bias's random walk in this boot differs from the model's.

        It is the geometric mean of the factors of all hypotheses, weighted by their probabilities.
        """
        logs = _PRIOR + self.told
        likely = np.exp(logs - logs.max())
        return float(np.exp(likely @ np.log(_FACTORS) / likely.sum()))
