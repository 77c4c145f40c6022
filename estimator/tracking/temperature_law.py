"""Temperature law of a bias: bias(T) = offset of the boot + linear (T - T0) + quadratic (T - T0)² + random walk."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class TemperatureLaw:
    """Temperature law of one device.

    linear (3,) rad/s/K and quadratic (3,) rad/s/K² about reference_c, T0 in °C; cov (3, 2, 2): covariance of the two by axis.
    Raises ValueError for other shapes.
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
        """(3,) slope of the bias at a temperature, rad/s/K."""
        return self.linear + 2 * (celsius - self.reference_c) * self.quadratic

    def slope_var(self, celsius: float) -> Floats:
        """(3,) variance of the slope at a temperature, (rad/s/K)²; it grows away from the temperatures seen."""
        by = np.array([1.0, 2 * (celsius - self.reference_c)])
        return np.asarray(self.cov @ by @ by)

    def change(self, from_c: float, to_c: float) -> Floats:
        """(3,) change of the bias, rad/s, from temperature from_c to temperature to_c, °C."""
        return (to_c - from_c) * self.slope((from_c + to_c) / 2)
