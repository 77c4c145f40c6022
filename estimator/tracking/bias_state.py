"""State of the bias filter (bias in rad/s, slope by temperature in rad/s/K), its initial value, and its process noise."""

from dataclasses import dataclass
from math import exp, expm1, radians

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

BIAS, SLOPE = slice(0, 3), slice(3, 6)
#: number of the filter's own states
OWN = 6


@dataclass(frozen=True, slots=True)
class BiasKnobs:
    """Settings of the bias filter: process noise, and prior of the slope by temperature.

    rate_random_walk: random walk of the bias at constant temperature, rad/s per root second.
    warm_up_walk, warm_up_s: additional random walk at power-up, rad/s per root second, and its decay time, s. Used
        where no temperature is known.
    per_kelvin: prior standard deviation of the slope, rad/s/K.
    curvature: standard deviation of the slope's change per kelvin, rad/s/K².
    flicker: standard deviation of the bias instability, rad/s. It is not a state of the filter.
    """

    #: rate random walk at a constant temperature, rad/s per root second
    rate_random_walk: float = radians(8e-4)
    #: additional walk at power-up, rad/s per root second, while no temperature reading explains the warming; and its time
    #: constant, s: the device's own heat takes minutes, a wearer's skin ten (tests/consistency/test_warming.py)
    warm_up_walk: float = radians(3e-3)
    warm_up_s: float = 600.0
    #: prior standard deviation of the slope, rad/s/K
    per_kelvin: float = radians(0.03)
    #: change of the slope per kelvin, rad/s/K²
    curvature: float = radians(0.001)
    #: rad/s, standard deviation of the bias instability about a mean over minutes. Not a state of the filter: a faster walk
    #: that follows it improves the bias by 7 % at most, for the worst of the device kinds that come with truerate
    flicker: float = 0.0

    def warmed(self, since_power_up: float, dt: float) -> float:
        """Variance per axis, (rad/s)², that warming up adds to the bias in dt seconds, where no temperature is known.

        since_power_up: seconds from power-up to the start of the dt seconds.
        """
        fading = exp(-max(0.0, since_power_up) / self.warm_up_s)
        return self.warm_up_walk**2 * fading * -expm1(-dt / self.warm_up_s) * self.warm_up_s


@dataclass(frozen=True, slots=True, eq=False)
class BiasState:
    """State of the bias filter at a device time, s: x (n,) with covariance P (n, n).

    x: bias (3) rad/s, its slope by temperature (3) rad/s/K, and appended states (see gravity.py).
    temperature_c: temperature averaged over 10 s, °C; NaN when unknown.
    powered: device time of power-up, s; -inf when unknown.
    bent_c: temperature at which variance was last added to the slope, °C; NaN when never.
    lag_k: latest temperature reading minus the average, K.
    """

    x: Floats
    P: Floats
    time: float
    temperature_c: float = np.nan
    powered: float = -np.inf
    #: temperature at which the slope was last allowed to change, °C
    bent_c: float = np.nan
    lag_k: float = 0.0

    @property
    def bias(self) -> Floats:
        """Estimated bias (3,), the reading at zero rate, rad/s."""
        return self.x[BIAS]

    @property
    def bias_cov(self) -> Floats:
        """Covariance (3, 3) of the bias, (rad/s)²."""
        return self.P[BIAS, BIAS]

    @property
    def std(self) -> Floats:
        """Standard deviation (3,) of the bias, rad/s."""
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
    """Initial state of the bias filter from a bias (3,), rad/s, with covariance cov (3, 3), (rad/s)².

    The slope by temperature is zero, with the prior variance of `knobs`.
    time, powered: device time now and at power-up, s. temperature_c: °C, NaN when unknown.
    """
    P = np.zeros((OWN, OWN))
    P[BIAS, BIAS], P[SLOPE, SLOPE] = cov, knobs.per_kelvin**2 * np.eye(3)
    return BiasState(np.concatenate([bias, np.zeros(3)]), P, time, temperature_c, powered)
