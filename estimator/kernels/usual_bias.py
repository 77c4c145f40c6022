"""Kernel of tracking/usual_bias.py: mean of a bias under a narrower prior."""

import numpy as np

from estimator.kernels.compiled import Floats, compiled


@compiled("f8[::1](f8[:], f8[:, :], f8[:], f8[:], f8, f8)")
def narrowed(bias: Floats, cov: Floats, mean: Floats, wide_std: Floats, usual_std: float, gate: float) -> Floats:
    """Mean (3,) of a bias, rad/s, when its prior narrows from wide_std (3,) to usual_std, both about mean (3,).

    bias (3,), cov (3, 3): estimate under the wide prior, rad/s, and its covariance, (rad/s)².
    mean (3,), wide_std (3,), usual_std: mean and standard deviations of the priors, rad/s.
    gate: largest NIS (3 degrees of freedom) of `bias` against the narrow prior. Above it, `bias` is returned unchanged.
    """
    x, P, nis = bias.copy(), cov.copy(), 0.0
    for axis in range(3):
        # What turns the wide prior into the usual one, as a measurement of the mean: information adds.
        off, S = mean[axis] - x[axis], P[axis, axis] + 1 / (1 / usual_std**2 - 1 / wide_std[axis] ** 2)
        K, nis = P[axis] / S, nis + off**2 / S
        x += K * off
        P -= np.outer(K, P[axis])
    return bias.copy() if nis > gate else x
