"""Temperature law of a gyro bias (rad/s): offset of the boot + linear (T - T0) + quadratic (T - T0)² + random walk."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class TemperatureLaw:
    """Temperature law of one device: coefficients of the bias about a reference temperature.

    reference_c: T0, °C.
    linear (3,): rad/s/K, one per axis. quadratic (3,): rad/s/K².
    cov (3, 2, 2): covariance of (linear, quadratic) for each axis, in squares of their units.
    Raises ValueError for arrays of other shapes.
    """

    reference_c: float
    linear: Floats
    quadratic: Floats
    cov: Floats

    def __post_init__(self) -> None:
        for array, shape in ((self.linear, (3,)), (self.quadratic, (3,)), (self.cov, (3, 2, 2))):
            if array.shape != shape:
                raise ValueError(f"a temperature law has {array.shape}, expected {shape}")

    def slope(self, celsius: float) -> Floats:
        """Slope (3,) of the bias at a temperature in °C, rad/s/K."""
        return self.linear + 2 * (celsius - self.reference_c) * self.quadratic

    def slope_var(self, celsius: float) -> Floats:
        """Variance (3,) of the slope at a temperature in °C, (rad/s/K)²; it grows away from the temperatures of the data."""
        by = np.array([1.0, 2 * (celsius - self.reference_c)])
        return np.asarray(self.cov @ by @ by)

    def change(self, from_c: float, to_c: float) -> Floats:
        """Change (3,) of the bias, rad/s, from temperature from_c to temperature to_c, °C."""
        return (to_c - from_c) * self.slope((from_c + to_c) / 2)
