"""Keeps a bias without evidence near usual values.

A few gyros of an unknown kind start with a bias of 5 °/s, and the prior must be as wide as that; most start within 0.5
°/s. In an axis that evidence does not reach, a wide prior lets the estimate follow every error of the evidence. Here
its mean is taken under the usual prior, unless the evidence contradicts that; its covariance stays that of the wide
one.
"""

from estimator.kernels.usual_bias import narrowed
from estimator.tracking.evidence import GATES, Floats

#: relative variance below which the prior has no say any more
_KNOWN = 1e-3


def nearer(bias: Floats, cov: Floats, mean: Floats, wide_std: Floats, usual_std: float) -> Floats:
    """(3,) mean of the bias under a usual prior, from its estimate (3,) with covariance (3, 3) under a wide one. rad/s.

    mean (3,): of both priors; wide_std (3,), usual_std: their standard deviations.
    """
    if max(cov.diagonal().tolist()) < _KNOWN * usual_std**2 or not min(wide_std.tolist()) > usual_std:
        return bias
    return narrowed(bias, cov, mean, wide_std, usual_std, GATES[3])
