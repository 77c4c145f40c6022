"""Generalised least squares: one Gauss-Newton step, its covariance, and the misfit of the residuals.

Letters: f (n,) residuals, F (n, p) their derivatives by the parameters, C (n, n) the covariance of f. Units are those
of the caller's residuals and parameters.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import log

import numpy as np
import scipy
from numpy.typing import NDArray

from estimator.calibration.capture import Floats

#: eigenvalues of the residual covariance below this share of the largest are zero: the parameters absorb these
#: directions
_ZERO = 1e-8
#: probability of the residuals below which they widen the covariance
HONEST_P = 0.01
#: one-sigma factor of the prior on an error's size
_FACTOR = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """One Gauss-Newton step (p,), its size in standard deviations, and the covariance (p, p) of the parameters.

    residual (n,): residuals after the step. left (n, n): their covariance.
    cost: -2 log of the restricted likelihood, up to a constant. It serves to compare assumed covariances of the
        residuals.
    Units are those of the caller's parameters and residuals.
    """

    step: Floats
    step_size: float
    cov: Floats
    residual: Floats
    left: Floats
    cost: float

    def misfit(self, rows: slice | NDArray[np.bool_] = slice(None)) -> float:
        """Reduced chi-square of selected residuals (chi-square over degrees of freedom), no unit, for scaling a covariance.

        rows: selects the residuals; by default all.
        Returns 1 where the chi-square is within its 99 % range.
        """
        value, vector = np.linalg.eigh(self.left[rows][:, rows])
        free = value > _ZERO * value[-1]
        chi2 = (vector.T @ self.residual[rows])[free] ** 2 / value[free]
        by_chance = scipy.special.chdtri(len(chi2), HONEST_P) if len(chi2) else np.inf
        return float(chi2.mean()) if chi2.sum() > by_chance else 1.0


def solve(f: Floats, F: Floats, C: Floats) -> Solved:
    """Gauss-Newton step that minimises f' C⁻¹ f for residuals f (n,) linear in the parameters, with its covariance.

    F (n, p): derivatives of f by the parameters. C (n, n): covariance of f.
    Raises LinAlgError when F leaves a parameter undetermined, or C is not positive definite.
    """
    lower = np.linalg.cholesky(C)
    both = np.linalg.solve(lower, np.column_stack([F, f]))
    white = both[:, :-1]
    step = -np.linalg.lstsq(white, both[:, -1], rcond=None)[0]
    information = white.T @ white
    cov = np.asarray(np.linalg.inv(information))
    size, chi2 = float(np.linalg.norm(white @ step)), float(np.sum((both[:, -1] + white @ step) ** 2))
    cost = chi2 + 2 * float(np.log(np.diag(lower)).sum()) + float(np.linalg.slogdet(information)[1])
    return Solved(np.asarray(step), size, cov, f + F @ step, C - F @ cov @ F.T, cost)


def shown_size(fit: Callable[[float], Solved], told: float, worst: float) -> float:
    """Estimate the standard deviation of one error kind from the residuals, by restricted likelihood with a prior.

    fit: solves the least-squares problem for a given size of the error.
    told: prior size; the prior is log-normal with a factor of ten as one standard deviation.
    worst: largest size tried.
    Sizes and result have the unit of `told`. The result is the root of the posterior mean of the squared size, on a
    grid from a tenth of `told` to `worst`.
    """
    sizes = np.geomspace(0.1 * told, worst, 19)
    cost = np.array([fit(float(size)).cost for size in sizes]) + (np.log(sizes / told) / log(_FACTOR)) ** 2
    weight = np.exp((cost.min() - cost) / 2)
    return float(np.sqrt(weight @ sizes**2 / weight.sum()))
