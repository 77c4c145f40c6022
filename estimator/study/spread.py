"""Spread of a sample of numbers: quantiles, and median and mean with their 95 % intervals."""

from math import sqrt

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

_Z = 1.959964


class Spread(Struct, frozen=True, kw_only=True):
    """Spread of n numbers: mean, median, quantiles, extremes and rms, all in the unit of the numbers.

    mean_ci: 95 % interval of the mean, by the normal distribution.
    median_ci: 95 % interval of the median, by order statistics.
    quantiles: 2.5, 25, 75 and 97.5 %. least, largest: extremes.
    """

    n: int
    mean: float
    mean_ci: tuple[float, float]
    median: float
    median_ci: tuple[float, float]
    quantiles: tuple[float, float, float, float]
    least: float
    largest: float
    rms: float

    @property
    def band(self) -> tuple[float, float]:
        """Interval of the middle 95 % of the numbers: 2.5 and 97.5 % quantiles."""
        return self.quantiles[0], self.quantiles[3]

    @property
    def quartiles(self) -> tuple[float, float]:
        """Interval of the middle half of the numbers: 25 and 75 % quantiles."""
        return self.quantiles[1], self.quantiles[2]


def spread(values: NDArray[np.float64]) -> Spread:
    """Compute mean, median, quantiles and rms of values (n,), with 95 % intervals of mean and median, in their unit."""
    x = np.sort(np.asarray(values, dtype=np.float64))
    n, mean = len(x), float(x.mean())
    half = _Z * float(x.std(ddof=1)) / sqrt(n) if n > 1 else float("inf")
    rank = _Z * sqrt(n) / 2
    low, high = max(0, int(np.floor(n / 2 - rank))), min(n - 1, int(np.ceil(n / 2 + rank)))
    return Spread(
        n=n,
        mean=mean,
        mean_ci=(mean - half, mean + half),
        median=float(np.median(x)),
        median_ci=(float(x[low]), float(x[high])),
        quantiles=tuple(float(q) for q in np.quantile(x, (0.025, 0.25, 0.75, 0.975))),  # type: ignore[arg-type] # four
        least=float(x[0]),
        largest=float(x[-1]),
        rms=float(np.sqrt(np.mean(x**2))),
    )


def holds(interval: tuple[float, float], value: float) -> bool:
    """Return True if an interval contains a value, its ends included."""
    return interval[0] <= value <= interval[1]
