"""A device's temperature law, learnt over its boots by generalised least squares, axis by axis.

The offset of each boot is unknown, the walk is part of the covariance, and a prior says what parts are like. A boot whose own
points scatter counts for less, and boots that disagree with one another widen the covariance (R. T. Birge, Phys. Rev. 40 (1932)
207).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from estimator.tracking.bias_filter import BiasKnobs
from estimator.tracking.temperature_law import TemperatureLaw

Floats = NDArray[np.float64]

#: K, a boot that saw no more than this teaches nothing
LEAST_SPAN_K = 2.0
#: a tracked bias that owes more than this share to the one before it is no news
_SHARE = 0.25
#: relative, what is taken for no information in some direction
_NOTHING = 1e-9
#: rad/s, no bias is known better
_LEAST_STD = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """m tracked biases of one boot in order: time (m,) s, bias (m, 3) rad/s and its std (m, 3), temperature_c (m,)."""

    time: Floats
    bias: Floats
    std: Floats
    temperature_c: Floats


def learn(boots: Sequence[Points], knobs: BiasKnobs) -> TemperatureLaw | None:
    """The law of a device from some of its boots; None while they have not seen enough of temperature."""
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
    """Those points that owe little to the ones before: the bias has walked since, or new evidence has told more of it."""
    kept = [0]
    for i, var in enumerate(boot.std**2):
        before = boot.std[kept[-1]] ** 2 + walk**2 * (boot.time[i] - boot.time[kept[-1]])
        if (var < _SHARE * before).all():
            kept.append(i)
    return Points(boot.time[kept], boot.bias[kept], boot.std[kept], boot.temperature_c[kept])


@dataclass(frozen=True, slots=True, eq=False)
class _Told:
    """What one boot says of one axis: information (2, 2), information times value (2,), and how many directions it knows."""

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
    rest = white[:, 1:] - one @ (one.T @ white[:, 1:])  # whatever the offset is
    A, y = rest[:, :2], rest[:, 2]
    best, _, rank, _ = np.linalg.lstsq(A, y, rcond=_NOTHING)
    scatter = max(1.0, float(np.sum((y - A @ best) ** 2)) / max(1, m - 1 - int(rank)))
    return _Told(A.T @ A / scatter, A.T @ y / scatter, int(rank))


def _fit(told: list[_Told], prior: Floats) -> tuple[Floats, Floats]:
    """Value (2,) and covariance (2, 2) of one axis from all its boots and a prior about zero."""
    info, vector = sum((one.info for one in told), np.zeros((2, 2))), sum((one.vector for one in told), np.zeros(2))
    freedom = sum(one.rank for one in told) - max(one.rank for one in told)
    disagree = sum(_explained(one.info, one.vector) for one in told) - _explained(info, vector)
    info_weight = 1 / max(1.0, disagree / freedom) if freedom else 1.0
    cov = np.linalg.inv(info_weight * info + np.linalg.inv(prior))
    return info_weight * cov @ vector, cov


def _explained(info: Floats, vector: Floats) -> float:
    return float(vector @ np.linalg.pinv(info, rcond=_NOTHING, hermitian=True) @ vector)
