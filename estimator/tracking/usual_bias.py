"""Prior for a bias without evidence: keeps the estimate near usual turn-on values.

A few gyros of an unknown kind start with a bias of 5 °/s, so the filter's prior must be that wide. Most start within
0.5 °/s. On an axis that evidence does not reach, a wide prior lets the estimate follow every error of the evidence.
This module computes the mean of the bias under the usual, narrow prior instead, unless the evidence contradicts that
prior. The covariance stays that of the wide prior.
"""

from estimator.kernels.usual_bias import narrowed
from estimator.tracking.evidence import GATES, Floats

#: relative variance below which the prior has no say any more
_KNOWN = 1e-3


def nearer(bias: Floats, cov: Floats, mean: Floats, wide_std: Floats, usual_std: float) -> Floats:
    """Mean (3,) of the bias under a narrow prior, rad/s, from its estimate under a wide prior.

    bias (3,), cov (3, 3): the estimate under the wide prior, rad/s, and its covariance, (rad/s)².
    mean (3,): mean of both priors, rad/s.
    wide_std (3,), usual_std: standard deviations of the wide and the narrow prior, rad/s.
    Returns `bias` unchanged in three cases. Its variance is below a thousandth of usual_std² on every axis; it
    contradicts the narrow prior; or the wide prior is not wider than the narrow one.
    """
    if max(cov.diagonal().tolist()) < _KNOWN * usual_std**2 or not min(wide_std.tolist()) > usual_std:
        return bias
    return narrowed(bias, cov, mean, wide_std, usual_std, GATES[3])
