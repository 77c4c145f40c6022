"""Generalised least squares: one Gauss-Newton step, its covariance, and how well the residuals keep to theirs.

Letters: f (n,) residuals, F (n, p) their derivatives by the parameters, C (n, n) the covariance of f.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import log

import numpy as np
import scipy
from numpy.typing import NDArray

from estimator.calibration.capture import Floats

#: eigenvalues of what is left of C below this share of the largest are zero: the parameters took them
_ZERO = 1e-8
#: where residuals are less probable than this, they are taken to be as bad as they show
HONEST_P = 0.01
#: how far an error's size may be from what was told of it: a factor, one standard deviation
_FACTOR = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """The step (p,) to add to the parameters, and its size in standard deviations; their covariance (p, p).

    residual (n,) after the step, and left (n, n), the covariance of these residuals. cost: -2 log of the restricted
    likelihood of C, up to a constant.
    """

    step: Floats
    step_size: float
    cov: Floats
    residual: Floats
    left: Floats
    cost: float

    def misfit(self, rows: slice | NDArray[np.bool_] = slice(None)) -> float:
        """Chi-square over degrees of freedom of some of the residuals by themselves, 1 where chance explains what is more."""
        value, vector = np.linalg.eigh(self.left[rows][:, rows])
        free = value > _ZERO * value[-1]
        chi2 = (vector.T @ self.residual[rows])[free] ** 2 / value[free]
        by_chance = scipy.special.chdtri(len(chi2), HONEST_P) if len(chi2) else np.inf
        return float(chi2.mean()) if chi2.sum() > by_chance else 1.0


def solve(f: Floats, F: Floats, C: Floats) -> Solved:
    """The step that makes f' C⁻¹ f least, f being linear; raises LinAlgError when F leaves a parameter open."""
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
    """The size of an error as the residuals show it: told within a factor of ten, and no more than `worst`.

    The root of the posterior mean of its square, from the restricted likelihood of `fit` under each size and a log-normal
    prior, on a grid from a tenth of what was told.
    """
    sizes = np.geomspace(0.1 * told, worst, 19)
    cost = np.array([fit(float(size)).cost for size in sizes]) + (np.log(sizes / told) / log(_FACTOR)) ** 2
    weight = np.exp((cost.min() - cost) / 2)
    return float(np.sqrt(weight @ sizes**2 / weight.sum()))
