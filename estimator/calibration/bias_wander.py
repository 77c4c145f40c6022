"""Covariance of a gyro's mean bias over stretches of a recording, scaled to the bias changes that the rests show.

A wandering bias is the sum of a random walk and flicker noise (IEEE Std 952-1997, Annex B). Letters:

    N, B    rate random walk, rad/s/√s; bias instability, rad/s: one-sided density B²/(pi f), f in Hz
    h       generalised covariance of the bias, (rad/s)², at two times that are tau (s) apart:
            h(tau) = -N² tau/2 - B²/pi ln tau; a constant may be added to h without effect on W
    H       function whose second derivative in tau is h. The covariance of the mean biases of two stretches,
            the mean of h over both, is the sum of four signed values of H over the product of the lengths (s)
    W       (n, n), (rad/s)²: covariance of the mean biases of n stretches, after subtracting the mean bias of
            the reference stretch
    D       (n, n), (rad/s)²: the same for a steady drift, as of a device that warms up
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import log, radians

import numpy as np

from estimator.calibration.capture import Floats
from estimator.calibration.constant_rates import Plateau

#: trial sizes of the wander relative to the knobs; and the prior's one-sigma factor
_SIZES, _FACTOR = np.geomspace(0.05, 20.0, 61), 3.0


@dataclass(frozen=True, slots=True)
class WanderKnobs:
    """Prior size of the bias wander: bias instability (rad/s), rate random walk (rad/s/√s) and warm-up drift (rad/s²).

    The defaults are those of the device model `generic`.
    """

    #: rad/s, B; the flat of the Allan deviation is 0.664 B
    bias_instability: float = radians(0.014)
    #: rad/s/√s, N
    rate_random_walk: float = radians(7e-4)
    #: rad/s², bias drift of a device that warms up
    drift: float = radians(0.1 / 60)


def wander_cov(stretches: Sequence[Plateau], reference: int, rests: Sequence[Plateau], knobs: WanderKnobs) -> Floats:
    """Covariance (n, n), (rad/s)², of one axis's wandering bias in n stretches, relative to the reference stretch.

    stretches: n stretches of constant rate. Row i of the result refers to the mean bias of stretch i minus that of
        stretch number `reference`.
    rests: stretches without rotation. Their mean readings give a scale for the prior size of the wander, by restricted
        maximum likelihood. With fewer than three rests the prior size is used.
    knobs: prior size of the wander, and the warm-up drift that is added.
    """
    return _shown_size(rests, knobs) ** 2 * _wander(stretches, reference, knobs) + _drift(stretches, reference, knobs)


def _wander(stretches: Sequence[Plateau], reference: int, knobs: WanderKnobs) -> Floats:
    """W for the size that the knobs give."""
    start, end = np.array([(stretch.start, stretch.end) for stretch in stretches]).T

    def second(tau: Floats) -> Floats:
        size = np.maximum(np.abs(tau), 1e-9)
        flicker = knobs.bias_instability**2 / np.pi * size**2 * (np.log(size) / 2 - 0.75)
        return np.asarray(-(knobs.rate_random_walk**2) * size**3 / 12 - flicker)

    ends, starts = end[:, None], start[:, None]
    both = second(ends - start) - second(starts - start) - second(ends - end) + second(starts - end)
    h = both / ((ends - starts) * (end - start))
    return np.asarray(h - h[:, [reference]] - h[[reference]] + h[reference, reference])


def _drift(stretches: Sequence[Plateau], reference: int, knobs: WanderKnobs) -> Floats:
    """Covariance matrix D of a steady drift."""
    middle = np.array([(stretch.start + stretch.end) / 2 for stretch in stretches])
    way = knobs.drift * (middle - middle[reference])
    return np.outer(way, way)


def _shown_size(rests: Sequence[Plateau], knobs: WanderKnobs) -> float:
    """Most likely size of the wander from the differences between rests, relative to the knobs.

    Restricted likelihood of the three axes together. Prior: the knobs are correct within a factor of three.
    """
    if len(rests) < 3:
        return 1.0
    W, D = _wander(rests, 0, knobs), _drift(rests, 0, knobs)
    mean, var = np.array([rest.mean for rest in rests]), np.array([rest.var for rest in rests])
    ones = np.ones(len(rests))
    cost = (np.log(_SIZES) / log(_FACTOR)) ** 2
    for axis in range(3):
        C = _SIZES[:, None, None] ** 2 * W + D + np.diag(var[:, axis])
        y = mean[:, axis] - mean[0, axis]
        by_one, by_y = np.moveaxis(np.linalg.solve(C, np.column_stack([ones, y])), -1, 0)
        information = by_one @ ones
        cost += np.linalg.slogdet(C)[1] + np.log(information) + by_y @ y - (by_one @ y) ** 2 / information
    return float(_SIZES[np.argmin(cost)])
