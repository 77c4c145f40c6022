"""Learns how fast the bias of this boot walks, from its own rests.

A bank of random walks runs beside the bias filter, one scalar filter a hypothesis and axis: the model's rate random walk times
a factor. The rests' means give each its likelihood. The factor in use is the mean of theirs on a logarithmic scale, weighted
by probability. Warming up is expected by all of them alike: rests of minutes do not show that it has ended.
Source: multiple-model estimation, D. T. Magill, "Optimal adaptive estimation of sampled stochastic processes",
IEEE Trans. Automatic Control 10 (1965).
"""

from dataclasses import dataclass
from math import isnan, radians

import msgspec
import numpy as np
from numpy.typing import NDArray

from estimator.state import StateStruct, shaped
from estimator.tracking.bias_state import BiasKnobs
from estimator.tracking.seconds import Second

Floats = NDArray[np.float64]

#: s, tolerance when the end of a second is compared with the start of the next
_SAME_S = 1e-3


@dataclass(frozen=True, slots=True)
class WalkKnobs:
    """Hypotheses about how fast the bias walks, and how rests are measured to tell between them."""

    #: factors of the model's rate random walk, and their prior weights
    factors: tuple[float, ...] = (0.5, 1.0, 2.0, 4.0, 8.0)
    weights: tuple[float, ...] = (3.0, 8.0, 4.0, 1.5, 0.5)
    #: seconds of rest in a row whose mean is one measurement
    block: int = 5
    #: rad/s, error of such a mean beside its noise
    floor: float = radians(0.001)
    #: largest squared innovation in units of its variance: a jump is no walk
    most: float = 12.0
    #: share of what was learnt that each measurement leaves
    kept: float = 0.99


class WalkState(StateStruct):
    """State of the bank of h walks: told (h,) log-likelihoods; x (h, 3) rad/s, P (h, 3) (rad/s)² means and variances.

    time, s, and celsius, °C: of the last measurement. block: seconds of the next one so far, as (end, mean, variance,
    °C).
    """

    told: Floats
    x: Floats
    P: Floats
    time: float = float("nan")
    celsius: float = float("nan")
    block: list[tuple[float, Floats, Floats, float]] = msgspec.field(default_factory=list)


class WalkRate:
    """Bank of random walks of one boot: rests in; out `pace`, the factor of the walk's variance.

    powered: device time of the power-up, s; -inf when unknown, and then nothing warms up.
    """

    def __init__(self, bias: BiasKnobs, powered: float, knobs: WalkKnobs | None = None) -> None:
        self.knobs, self._bias, self._powered = knobs or WalkKnobs(), bias, powered
        self._prior, self._factors = np.log(self.knobs.weights), np.array(self.knobs.factors) ** 2
        n = len(self._factors)
        self.state = WalkState(np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3)))
        self.pace = self._weighed()

    def restore(self, state: WalkState) -> None:
        """Restore a saved state. Raises ValueError when it is damaged."""
        n = len(self._factors)
        shaped(state.told, n, finite=True)
        shaped(state.x, n, 3, finite=True)
        shaped(state.P, n, 3, finite=True)
        for _, mean, var, _ in state.block:
            shaped(mean, 3, finite=True)
            shaped(var, 3, finite=True)
        self.state = state
        self.pace = self._weighed()

    def take(self, second: Second, celsius: float, slope: Floats, slope_var: Floats) -> None:
        """Add a second of rest; after `WalkKnobs.block` of them in a row, `pace` is learnt from their mean.

        celsius: °C, NaN if unknown; slope (3,) rad/s/K of the bias by temperature, slope_var (3,) its variance.
        """
        block = self.state.block
        if block and second.start - block[-1][0] > _SAME_S:
            block.clear()
        block.append((second.end, second.mean, second.mean_var, celsius))
        n = len(block)
        if n < self.knobs.block:
            return
        means, variances = (np.array(column) for column in list(zip(*block, strict=True))[1:3])
        # What breathing moves shows in the scatter.
        R = np.maximum(variances.mean(axis=0), means.var(axis=0, ddof=1)) / n + self.knobs.floor**2
        self._measured(block[n // 2][0], means.mean(axis=0), R, celsius, slope, slope_var)
        block.clear()

    def _measured(self, time: float, z: Floats, R: Floats, celsius: float, slope: Floats, slope_var: Floats) -> None:
        state = self.state
        dt, warmer = time - state.time, celsius - state.celsius
        if dt > 0:
            walked = self._bias.rate_random_walk**2 * dt * self._factors
            if isnan(warmer):
                warmer = 0.0
                walked += self._bias.warmed(state.time - self._powered, dt)
            P = state.P + walked[:, None] + warmer**2 * slope_var
            S, off = P + R, z - state.x - warmer * slope
            told = -0.5 * (np.log(S) + np.minimum(off**2 / S, self.knobs.most)).sum(axis=1)
            state.told = self.knobs.kept * state.told + (told - told.max())
            state.x, state.P = z - (1 - P / S) * off, P * (1 - P / S)
            self.pace = self._weighed()
        else:  # the first one
            state.x, state.P = np.tile(z, (len(state.x), 1)), np.tile(R, (len(state.x), 1))
        state.time, state.celsius = time, celsius

    def _weighed(self) -> float:
        logs = self._prior + self.state.told
        likely = np.exp(logs - logs.max())
        return float(np.exp(likely @ np.log(self._factors) / likely.sum()))
