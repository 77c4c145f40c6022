"""Angle random walk, bias instability and rate random walk from an Allan variance, each with an interval.

With angle random walk N, bias instability B and rate random walk K, and a steady drift R where these do not suffice,

    σ²(τ) = N²/τ + B² (2 ln 2)/π + K² τ/3 + R² τ²/2          IEEE Std 952-1997, annex C; El-Sheimy, Hou and Niu 2008

An estimate with ν degrees of freedom is distributed as σ² χ²/ν. The fit to the octaves of τ is maximum likelihood with no
square below zero; an interval ends where the likelihood, maximised over the other coefficients, has fallen by that of 95 %.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import log, pi, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, nnls
from scipy.stats import chi2

from estimator.noise.allan import degrees_of_freedom, interval, octaves, overlapping

Floats = NDArray[np.float64]
#: the octaves of an overlapping estimate share data: their degrees of freedom add up to twice the samples there are, and
#: neighbours err together. With this divisor simulated intervals cover the truth as they say (tests/consistency).
_SHARED = 2.5
_FALL: float = float(chi2.ppf(0.95, 1))  # of twice the log-likelihood
_LEAST_OCTAVES = 6
#: more than this of the two least octaves is white noise where it is not shaped
_WHITE = 0.75


@dataclass(frozen=True, slots=True)
class Coefficient:
    """A coefficient, SI, and its 95 % interval; low is 0 where the record does not tell it from nothing."""

    value: float
    low: float
    high: float

    @property
    def seen(self) -> bool:
        """Whether the record shows it; else `high` is all that is known."""
        return self.low > 0


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """The noise of one axis: arw rad/s/√Hz, bias_instability rad/s, rrw rad/s/√s; drift rad/s², 0 where none is needed.

    At the octaves tau (m,) s: deviation, and its 95 % interval low to high, (m,) rad/s. fitted_from: the least τ, s, that
    the model explains; below it the device's own filter shapes the noise. misfit: about 1 where it explains the rest.
    """

    arw: Coefficient
    bias_instability: Coefficient
    rrw: Coefficient
    drift: float
    tau: Floats
    deviation: Floats
    low: Floats
    high: Floats
    fitted_from: float
    misfit: float

    def model(self, tau: Floats) -> Floats:
        """(m,) Allan deviation, rad/s, of all of it at averaging times tau (m,)."""
        sizes = np.array([self.arw.value, self.bias_instability.value, self.rrw.value, self.drift])
        return np.asarray(np.sqrt(sizes**2 @ shapes(tau) ** 2))


def shapes(tau: Floats) -> Floats:
    """(4, m) Allan deviation at tau (m,) of each noise and of a drift, were its coefficient 1."""
    return np.sqrt(_terms(tau)).T


def identify(rate: Floats, rate_hz: float) -> Noise:
    """The noise of one axis at rest from evenly sampled rates (n,), rad/s, that are not all the same; ValueError if few."""
    factors = octaves(len(rate))
    if len(factors) < _LEAST_OCTAVES:
        raise ValueError(f"{len(rate)} rates; at least {3 << (_LEAST_OCTAVES - 1)} are needed")
    variance = np.maximum(overlapping(rate, factors), 1e-12 * rate.var())  # what alternates averages to nothing
    tau = np.array(factors) / rate_hz
    terms, each = _terms(tau), degrees_of_freedom(len(rate), factors)
    each = np.column_stack([each, each[:, 2]])  # a drift has no scatter of its own: no better than a random walk
    first, fit = _explain(terms, variance, each)
    white = None if first == 0 else _white(terms, variance, each)
    if white is not None:
        first, fit = min(_tried(terms, variance, each, 0), key=lambda trial: trial[1].misfit)
    freedom = fit.mixed(terms, each)
    low, high = (np.sqrt(end) for end in interval(variance, freedom))
    arw, bias_instability, rrw = (fit.coefficient(i) for i in range(3))
    if white is not None:
        arw = white.coefficient(0)  # however little the model says of what is slower
    drift = sqrt(fit.squares[3]) if len(fit.squares) > 3 else 0.0
    return Noise(
        arw, bias_instability, rrw, drift, tau, np.sqrt(variance), low, high, float(tau[first]), max(fit.misfit, 1.0)
    )


def _terms(tau: Floats) -> Floats:
    return np.column_stack([1 / tau, np.full_like(tau, 2 * log(2) / pi), tau / 3, tau**2 / 2])


def _explain(terms: Floats, variance: Floats, each: Floats) -> tuple[int, "_Fit"]:
    """Leave out the least octaves, which the device's filter shapes, until the rest fits; if it never does, add a drift.

    Two more go with them, in which what is left of the filter, half as much an octave, would hide in the scatter.
    """
    most = max(len(variance) - _LEAST_OCTAVES, 0)
    tried = []
    for first, fit in _tried(terms, variance, each, most):
        tried.append((first, fit))
        if fit.explains:
            later, count = min(first + 2, most) if first else 0, len(fit.squares)
            return later, _Fit(terms[later:, :count], variance[later:], each[later:])
    return min(tried, key=lambda trial: trial[1].misfit)


def _tried(terms: Floats, variance: Floats, each: Floats, most: int) -> Iterator[tuple[int, "_Fit"]]:
    """Fits from each octave on, up to one; then with a drift."""
    for count in (3, 4):
        for first in range(most + 1):
            yield first, _Fit(terms[first:, :count], variance[first:], each[first:])


def _white(terms: Floats, variance: Floats, each: Floats) -> "_Fit | None":
    """The least octaves, if they are mostly white noise: no filter shapes them then, and what does not fit is slower."""
    fit = _Fit(terms[:_LEAST_OCTAVES, :3], variance[:_LEAST_OCTAVES], each[:_LEAST_OCTAVES])
    share = fit.squares[0] * terms[:2, 0] / variance[:2]
    return fit if fit.explains and (share > _WHITE).all() else None


class _Fit:
    """variance (m,) as terms (m, k) @ squares (k,); each (m, ≥ k) the degrees of freedom, were a term alone."""

    def __init__(self, terms: Floats, variance: Floats, each: Floats) -> None:
        self._terms, self._variance = terms, variance
        spare = max(len(variance) - terms.shape[1], 1)
        freedom = each.min(axis=1)
        for _ in range(4):
            self._weight = freedom / _SHARED
            self.squares = self._solve()
            freedom = self.mixed(terms, each)
        self._least = self._deviance(self.squares)
        self.misfit: float = self._least * _SHARED / spare
        self.explains = self.misfit < chi2.ppf(0.99, spare) / spare

    def mixed(self, terms: Floats, each: Floats) -> Floats:
        """(m,) degrees of freedom of the sum: its standard deviation is at most that of its parts, added up."""
        count = len(self.squares)
        parts = terms[:, :count] * self.squares
        share = parts / parts.sum(axis=1, keepdims=True)
        return np.asarray(1 / np.sum(share / np.sqrt(each[:, :count]), axis=1) ** 2)

    def coefficient(self, i: int) -> Coefficient:
        """The root of one of the squares, by profile likelihood; a misfit widens the interval."""
        best = self.squares[i]

        def beyond(square: float) -> float:
            fall = self._deviance(self._solve(i, square)) - self._least
            return fall / max(self.misfit, 1.0) - _FALL

        top = 2 * max(best, float(np.min(self._variance / self._terms[:, i])))
        while beyond(top) < 0:
            top *= 2
        high = brentq(beyond, best, top, rtol=1e-4)
        low = brentq(beyond, 0.0, best, rtol=1e-4) if best > 0 and beyond(0.0) > 0 else 0.0
        return Coefficient(sqrt(best), sqrt(low), sqrt(high))

    def _deviance(self, squares: Floats) -> float:
        """Twice the log-likelihood below that of a perfect fit."""
        ratio = self._variance / (self._terms @ squares)
        return float(np.sum(self._weight * (ratio - 1 - np.log(ratio))))

    def _solve(self, held: int | None = None, square: float = 0.0) -> Floats:
        """The squares of least deviance, one of them held: Fisher scoring by weighted non-negative least squares."""
        squares = np.zeros(self._terms.shape[1])
        free = [i for i in range(len(squares)) if i != held]
        if held is not None:
            squares[held] = square
        rest, fitted = self._variance - self._terms @ squares, self._variance
        for _ in range(30):
            scale = np.sqrt(self._weight) / fitted
            squares[free], _ = nnls(self._terms[:, free] * scale[:, np.newaxis], rest * scale)
            new = np.maximum(self._terms @ squares, 1e-12 * self._variance)
            if np.allclose(new, fitted, rtol=1e-7, atol=0):
                break
            fitted = np.sqrt(new * fitted)  # half of a step in the logarithm: a whole one may swing
        return squares
