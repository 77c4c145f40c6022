"""Rates of a gyro that lies still: white noise and a random walk, drawn here and nowhere else in the project."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def at_rest(seed: int, n: int, rate_hz: float, arw: float, rrw: float) -> Floats:
    """Rates (n,) with angle random walk and rate random walk, in their units of angle."""
    rng = np.random.default_rng(seed)
    return rng.normal(0, arw * np.sqrt(rate_hz), n) + np.cumsum(rng.normal(0, rrw / np.sqrt(rate_hz), n))
