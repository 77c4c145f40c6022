"""Arrivals at a host: packets of a few samples, mostly prompt, now and then held up; always in order."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def bursts(rng: np.random.Generator, seconds: float, rate_hz: float, skew: float = 0.0) -> tuple[Floats, Floats]:
    """(m,) device time of the last sample of packets of 20 to 50 ms, and when they come in at a host 1 + skew as slow."""
    ends = np.cumsum(rng.uniform(0.02, 0.05, int(seconds / 0.02)))
    device = np.unique(np.ceil(ends[ends < seconds] * rate_hz)) / rate_hz
    prompt = rng.random(len(device)) < 0.9
    late = np.where(prompt, rng.exponential(5e-4, len(device)), rng.exponential(0.03, len(device)))
    return device, np.maximum.accumulate(device * (1 + skew) + late)
