"""Overlapping Allan variance of a rate at rest, with the confidence interval of each point.

Textbook letters: m is the averaging factor, the averaging time τ in samples. N is the number of angles.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

Floats = NDArray[np.float64]


def octaves(n: int) -> list[int]:
    """Averaging factors 1, 2, 4 … (numbers of samples) up to a third of n samples."""
    return [1 << k for k in range(max(n // 3, 1).bit_length())]


def overlapping(rate: Floats, factors: Sequence[int]) -> Floats:
    """Overlapping Allan variance (m, …), in the unit of the rate squared, of evenly sampled rates (n, …).

    factors (m,): averaging times in samples, at most n / 2. Source: NIST SP 1065, eq. 11.
    """
    angle = np.cumsum(rate - rate.mean(axis=0), axis=0)
    angle = np.concatenate([np.zeros_like(angle[:1]), angle])
    second = (angle[2 * m :] - 2 * angle[m:-m] + angle[: -2 * m] for m in factors)
    return np.array([np.mean(d**2, axis=0) / (2 * m**2) for m, d in zip(factors, second, strict=True)])


def degrees_of_freedom(n: int, factors: Sequence[int]) -> Floats:
    """Equivalent degrees of freedom (m, 3) of the Allan variance of n samples, for three kinds of rate noise.

    Columns: white, flicker and random-walk rate noise. factors (m,): averaging factors.
    Source: NIST SP 1065, table 5: W FM, F FM and RW FM.
    """
    m, N = np.array(factors, dtype=float), n + 1.0
    white = (3 * (N - 1) / (2 * m) - 2 * (N - 2) / N) * 4 * m**2 / (4 * m**2 + 5)
    flicker = np.where(m == 1, 2 * (N - 2) ** 2 / (2.3 * N - 4.9), 5 * N**2 / (4 * m * (N + 3 * m)))
    walk = (N - 2) / m * ((N - 1) ** 2 - 3 * m * (N - 1) + 4 * m**2) / (N - 3) ** 2
    return np.column_stack([white, flicker, walk])


def interval(variance: Floats, freedom: Floats) -> tuple[Floats, Floats]:
    """Lower and upper end of the 95 % confidence interval of estimated variances, (m,) each.

    variance (m,): the estimates. freedom (m,): their degrees of freedom.
    Source: NIST SP 1065, eq. 45.
    """
    return variance * freedom / chi2.ppf(0.975, freedom), variance * freedom / chi2.ppf(0.025, freedom)
