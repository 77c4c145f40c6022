"""Fit of a device's temperature law to its boots by generalised least squares, axis by axis.

The offset of each boot is unknown. The random walk is part of the covariance. A prior gives the usual size of the
coefficients.
A boot whose points scatter gets less weight, and boots that disagree widen the covariance (R. T. Birge, Phys. Rev. 40
(1932) 207).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from estimator.tracking.bias_state import BiasKnobs, Floats
from estimator.tracking.temperature_law import TemperatureLaw

#: K, least temperature span of a boot used
LEAST_SPAN_K = 2.0
#: variance ratio; a tracked bias is used only if its variance is less than this share of the one before plus the walk
_SHARE = 0.25
#: relative, limit of singular values that count as no information
_NOTHING = 1e-9
#: rad/s, least standard deviation of a bias
_LEAST_STD = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Tracked biases of one boot at m times in increasing order, as data for a temperature law.

    time (m,): host time, s. bias (m, 3): rad/s. std (m, 3): its standard deviation, rad/s. temperature_c
    (m,): °C.
    """

    time: Floats
    bias: Floats
    std: Floats
    temperature_c: Floats


def learn(boots: Sequence[Points], knobs: BiasKnobs) -> TemperatureLaw | None:
    """Fit the temperature law of a device to some of its boots.

    knobs: rate random walk, and prior size of the coefficients.
    Returns None if in no boot the temperatures span 2 K.
    """
    walk = knobs.rate_random_walk
    boots = [_apart(boot, walk) for boot in boots if len(boot.time)]
    boots = [boot for boot in boots if np.ptp(boot.temperature_c) >= LEAST_SPAN_K]
    if not boots:
        return None
    reference = float(np.mean(np.concatenate([boot.temperature_c for boot in boots])))
    prior = np.diag([knobs.per_kelvin, knobs.curvature / 2]) ** 2
    found = [_fit([_told(boot, axis, reference, walk) for boot in boots], prior) for axis in range(3)]
    linear, quadratic = np.array([value for value, _ in found]).T
    return TemperatureLaw(reference, linear, quadratic, np.array([cov for _, cov in found]))


def _apart(boot: Points, walk: float) -> Points:
    """Select nearly independent points: the bias has walked since the one before, or new evidence has come."""
    kept = [0]
    for i, var in enumerate(boot.std**2):
        before = boot.std[kept[-1]] ** 2 + walk**2 * (boot.time[i] - boot.time[kept[-1]])
        if (var < _SHARE * before).all():
            kept.append(i)
    return Points(boot.time[kept], boot.bias[kept], boot.std[kept], boot.temperature_c[kept])


@dataclass(frozen=True, slots=True, eq=False)
class _Told:
    """Information of one boot on one axis: matrix (2, 2), vector (2,) = matrix times value, and rank."""

    info: Floats
    vector: Floats
    rank: int


def _told(boot: Points, axis: int, reference_c: float, walk: float) -> _Told:
    m, warmer = len(boot.time), boot.temperature_c - reference_c
    since = boot.time - boot.time[0]
    C = np.diag(np.maximum(boot.std[:, axis], _LEAST_STD) ** 2) + walk**2 * np.minimum.outer(since, since)
    all_of_it = np.column_stack([np.ones(m), warmer, warmer**2, boot.bias[:, axis]])
    white, _ = scipy.linalg.lapack.dtrtrs(np.linalg.cholesky(C), all_of_it, lower=1)
    one = white[:, :1] / np.linalg.norm(white[:, 0])
    rest = white[:, 1:] - one @ (one.T @ white[:, 1:])  # independent of the boot's offset
    A, y = rest[:, :2], rest[:, 2]
    best, _, rank, _ = np.linalg.lstsq(A, y, rcond=_NOTHING)
    scatter = max(1.0, float(np.sum((y - A @ best) ** 2)) / max(1, m - 1 - int(rank)))
    return _Told(A.T @ A / scatter, A.T @ y / scatter, int(rank))


def _fit(told: list[_Told], prior: Floats) -> tuple[Floats, Floats]:
    """Value (2,) and covariance (2, 2) of one axis, from all boots and a zero-mean prior."""
    info, vector = sum((one.info for one in told), np.zeros((2, 2))), sum((one.vector for one in told), np.zeros(2))
    freedom = sum(one.rank for one in told) - max(one.rank for one in told)
    disagree = sum(_explained(one.info, one.vector) for one in told) - _explained(info, vector)
    info_weight = 1 / max(1.0, disagree / freedom) if freedom else 1.0
    cov = np.linalg.inv(info_weight * info + np.linalg.inv(prior))
    return info_weight * cov @ vector, cov


def _explained(info: Floats, vector: Floats) -> float:
    return float(vector @ np.linalg.pinv(info, rcond=_NOTHING, hermitian=True) @ vector)
