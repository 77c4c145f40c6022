"""Variance components: size of each kind of error in a session, estimated from the session's own residuals.

The residuals r have the covariance C = C0 + sum of s_i² C_i. C0 is measured noise. C_i is the covariance assumed for
error kind i, and s_i (no unit) its scale.
Method: restricted likelihood by Fisher scoring, D. A. Harville, J. Am. Stat. Assoc. 72 (1977) 320. The unknowns are log
s_i, with a weak prior that matters only where the residuals carry little information.
The result is the posterior mean of s_i². It exceeds the most likely value where few residuals determine it, as in
Student's distribution.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: prior standard deviation of log s for accelerometer, paths and headings; the prior mean makes the mean of s² 1
_PRIOR_STD = np.array([1.5, 1.5, 0.7])
_PRIOR_MEAN = -(_PRIOR_STD**2)
_STEPS = 30
#: grid of log s around the most likely value, over which the mean is taken
_AROUND = np.linspace(-4.0, 3.0, 29)


@dataclass(frozen=True, slots=True, eq=False)
class Linear:
    """Linear model of residuals r (n,) with derivatives J (n, p) by the parameters, and covariance C0 + sum of s_i² C_i.

    noise (n, n): C0. parts (c, n, n): C_i of the c error kinds. Units are the squares of the residuals' units.
    information (p, p), gradient (p,): J'J and J'r of further residuals of variance 1, such as priors.
    """

    r: Floats
    J: Floats
    noise: Floats
    parts: Floats
    information: Floats
    gradient: Floats

    def log_posterior(self, log_s: Floats) -> float:
        """Log posterior of log s (c,), no unit: restricted log likelihood plus log prior, up to a constant."""
        lower = np.linalg.cholesky(self.noise + np.tensordot(np.exp(2 * log_s), self.parts, axes=1))
        white = np.linalg.solve(lower, np.column_stack([self.r, self.J]))
        r, J = white[:, 0], white[:, 1:]
        normal = np.linalg.cholesky(J.T @ J + self.information)
        explained = np.linalg.solve(normal, J.T @ r + self.gradient)
        fit = float(r @ r - explained @ explained) / 2
        size = float(np.log(np.diag(lower)).sum() + np.log(np.diag(normal)).sum())
        return -fit - size - float(np.sum(((log_s - _PRIOR_MEAN) / _PRIOR_STD) ** 2)) / 2

    def likeliest(self) -> Floats:
        """Return log s (c,) with the highest posterior, by Fisher scoring. s: scale of each error kind, without unit."""
        log_s = _PRIOR_MEAN.copy()
        prior = np.diag(1 / _PRIOR_STD**2)
        for _ in range(_STEPS):
            slopes = 2 * np.exp(2 * log_s)[:, None, None] * self.parts  # slopes of C by log s
            W = np.linalg.inv(self.noise + slopes.sum(axis=0) / 2)
            WJ = W @ self.J
            cov = np.linalg.inv(self.J.T @ WJ + self.information)
            left = W @ (self.r - self.J @ (cov @ (WJ.T @ self.r + self.gradient)))
            PV = (W - WJ @ cov @ WJ.T) @ slopes
            score = (left @ slopes @ left - np.trace(PV, axis1=1, axis2=2)) / 2 - prior @ (log_s - _PRIOR_MEAN)
            fisher = np.einsum("aij,bji->ab", PV, PV) / 2 + prior
            step = np.clip(np.linalg.solve(fisher, score), -1.0, 1.0)
            log_s = log_s + step
            if np.abs(step).max() < 0.02:
                break
        return log_s


def factors(model: Linear) -> Floats:
    """Estimate the variance (c,) of each error kind relative to the assumed one: posterior means of s_i², no unit.

    About 1 where the residuals carry no information on error kind i.
    """
    best = model.likeliest()
    found = np.empty(len(best))
    for i in range(len(best)):
        tried = best + _AROUND[:, None] * np.eye(len(best))[i]
        log_p = np.array([model.log_posterior(log_s) for log_s in tried])
        weight = np.exp(log_p - log_p.max())
        found[i] = weight @ np.exp(2 * tried[:, i]) / weight.sum()
    return found
