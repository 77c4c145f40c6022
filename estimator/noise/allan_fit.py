"""Overlapping Allan variance, and the three noise coefficients fitted to it, each with a 95 % interval.

Model of the Allan variance σ² (rad/s)² at averaging time τ (s):

    σ²(τ) = N²/τ + B² (2 ln 2)/π + K² τ/3 + R² τ²/2          IEEE Std 952-1997, annex C; El-Sheimy, Hou and Niu 2008

    N   angle random walk, rad/s/√Hz
    B   bias instability, rad/s
    K   rate random walk, rad/s/√s
    R   steady drift, rad/s², used only where the other three do not explain the data

An estimate with ν degrees of freedom is distributed as σ² χ²/ν. The fit to the octaves of τ is maximum likelihood with
non-negative squares. An interval is a profile likelihood. It ends where the likelihood, maximised over the other
coefficients, has fallen by the 95 % quantile.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import log, pi, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, nnls
from scipy.stats import chi2

Floats = NDArray[np.float64]
#: divisor of the degrees of freedom. The octaves of an overlapping estimate share data: their degrees of freedom add up
#: to twice the number of samples, and the errors of neighbours are correlated. With this divisor simulated intervals
#: have their nominal coverage (tests/consistency).
_SHARED = 2.5
_FALL: float = float(chi2.ppf(0.95, 1))  # drop of twice the log-likelihood
_LEAST_OCTAVES = 6
#: least share of white noise in the two shortest octaves where no filter shapes the noise
_WHITE = 0.75


def octaves(n: int) -> list[int]:
    """Averaging factors of the Allan variance for n samples: 1, 2, 4 … samples per average, up to n / 3."""
    return [1 << k for k in range(max(n // 3, 1).bit_length())]


def overlapping(rate: Floats, factors: Sequence[int]) -> Floats:
    """Overlapping Allan variance (m, …) of evenly sampled rates (n, …), in the square of their unit.

    factors (m,): averaging times in samples, at most n / 2. Source: NIST SP 1065, eq. 11.
    """
    angle = np.cumsum(rate - rate.mean(axis=0), axis=0)
    angle = np.concatenate([np.zeros_like(angle[:1]), angle])
    second = (angle[2 * m :] - 2 * angle[m:-m] + angle[: -2 * m] for m in factors)
    return np.array([np.mean(d**2, axis=0) / (2 * m**2) for m, d in zip(factors, second, strict=True)])


def degrees_of_freedom(n: int, factors: Sequence[int]) -> Floats:
    """Equivalent degrees of freedom (m, 3) of the Allan variance of n samples, for three kinds of rate noise.

    Columns: white, flicker and random-walk rate noise. factors (m,): averaging factors.
    Source: NIST SP 1065, table 5: W FM, F FM and RW FM.
    """
    m, N = np.array(factors, dtype=float), n + 1.0
    white = (3 * (N - 1) / (2 * m) - 2 * (N - 2) / N) * 4 * m**2 / (4 * m**2 + 5)
    flicker = np.where(m == 1, 2 * (N - 2) ** 2 / (2.3 * N - 4.9), 5 * N**2 / (4 * m * (N + 3 * m)))
    walk = (N - 2) / m * ((N - 1) ** 2 - 3 * m * (N - 1) + 4 * m**2) / (N - 3) ** 2
    return np.column_stack([white, flicker, walk])


def interval(variance: Floats, freedom: Floats) -> tuple[Floats, Floats]:
    """Lower and upper end of the 95 % confidence interval of estimated variances, (m,) each, in their unit.

    variance (m,): the estimates. freedom (m,): their degrees of freedom.
    Source: NIST SP 1065, eq. 45.
    """
    return variance * freedom / chi2.ppf(0.975, freedom), variance * freedom / chi2.ppf(0.025, freedom)


@dataclass(frozen=True, slots=True)
class Coefficient:
    """Noise coefficient: value and ends (low, high) of its 95 % interval, in the SI unit of its field in `Noise`.

    low is 0 where the record does not show the noise.
    """

    value: float
    low: float
    high: float

    @property
    def seen(self) -> bool:
        """True if the record shows this noise; if not, only the upper limit `high` is known."""
        return self.low > 0


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """Noise of one axis, from its Allan deviation.

    arw: angle random walk, rad/s/√Hz. bias_instability: rad/s. rrw: rate random walk, rad/s/√s.
    drift: steady drift, rad/s²; 0 where the fit needs none.
    tau (m,): averaging times (octaves), s. deviation (m,): Allan deviation at these, rad/s.
    low, high (m,): ends of its 95 % interval, rad/s.
    fitted_from: shortest averaging time that the model explains, s. Below it the device's own filter shapes the noise.
    misfit: reduced chi-square of the fit, no unit, at least 1; 1 where the model explains the octaves used.
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
        """Allan deviation (m,) of the fitted model, rad/s, at averaging times tau (m,), s."""
        sizes = np.array([self.arw.value, self.bias_instability.value, self.rrw.value, self.drift])
        return np.asarray(np.sqrt(sizes**2 @ shapes(tau) ** 2))


def shapes(tau: Floats) -> Floats:
    """Allan deviation (4, m) of each kind of noise with coefficient 1, at averaging times tau (m,), s.

    Rows: angle random walk, bias instability, rate random walk, drift. Times the coefficient in its SI unit, each row
        is in rad/s.
    """
    return np.sqrt(_terms(tau)).T


def identify(rate: Floats, rate_hz: float) -> Noise:
    """Identify the noise of one axis at rest from evenly sampled rates (n,), rad/s, at rate_hz samples a second.

    The rates must not all be equal. Raises ValueError for fewer than 96 rates.
    """
    factors = octaves(len(rate))
    if len(factors) < _LEAST_OCTAVES:
        raise ValueError(f"only {len(rate)} rates are given; at least {3 << (_LEAST_OCTAVES - 1)} rates are needed")
    variance = np.maximum(overlapping(rate, factors), 1e-12 * rate.var())  # alternating readings average to zero
    tau = np.array(factors) / rate_hz
    terms, each = _terms(tau), degrees_of_freedom(len(rate), factors)
    each = np.column_stack([each, each[:, 2]])  # a drift gets the degrees of freedom of a random walk
    first, fit = _explain(terms, variance, each)
    white = None if first == 0 else _white(terms, variance, each)
    if white is not None:
        first, fit = min(_tried(terms, variance, each, 0), key=lambda trial: trial[1].misfit)
    freedom = fit.mixed(terms, each)
    low, high = (np.sqrt(end) for end in interval(variance, freedom))
    arw, bias_instability, rrw = (fit.coefficient(i) for i in range(3))
    if white is not None:
        arw = white.coefficient(0)  # valid even where the model does not explain slower noise
    drift = sqrt(fit.squares[3]) if len(fit.squares) > 3 else 0.0
    return Noise(
        arw, bias_instability, rrw, drift, tau, np.sqrt(variance), low, high, float(tau[first]), max(fit.misfit, 1.0)
    )


def _terms(tau: Floats) -> Floats:
    return np.column_stack([1 / tau, np.full_like(tau, 2 * log(2) / pi), tau / 3, tau**2 / 2])


def _explain(terms: Floats, variance: Floats, each: Floats) -> tuple[int, "_Fit"]:
    """Fit without the shortest octaves, which the device's filter shapes, until the rest fits; add a drift if nothing fits.

    Two more octaves are left out after the first fit. The filter's remaining effect, halved per octave, would hide in
    the scatter there.
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
    """Fits that start at each octave from 0 to `most`, first without and then with a drift."""
    for count in (3, 4):
        for first in range(most + 1):
            yield first, _Fit(terms[first:, :count], variance[first:], each[first:])


def _white(terms: Floats, variance: Floats, each: Floats) -> "_Fit | None":
    """Fit of the shortest octaves if white noise dominates them, else None.

    No filter shapes white noise, so any misfit then comes from slower noise.
    """
    fit = _Fit(terms[:_LEAST_OCTAVES, :3], variance[:_LEAST_OCTAVES], each[:_LEAST_OCTAVES])
    share = fit.squares[0] * terms[:2, 0] / variance[:2]
    return fit if fit.explains and (share > _WHITE).all() else None


class _Fit:
    """Fit of variance (m,) as terms (m, k) @ squares (k,).

    each (m, ≥ k): degrees of freedom if a term were alone.
    """

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
        """Degrees of freedom (m,) of the sum: its standard deviation is at most the sum of those of its parts."""
        count = len(self.squares)
        parts = terms[:, :count] * self.squares
        share = parts / parts.sum(axis=1, keepdims=True)
        return np.asarray(1 / np.sum(share / np.sqrt(each[:, :count]), axis=1) ** 2)

    def coefficient(self, i: int) -> Coefficient:
        """Square root of one of the squares with its profile-likelihood interval; a misfit widens the interval."""
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
        """Twice the log-likelihood below a perfect fit."""
        ratio = self._variance / (self._terms @ squares)
        return float(np.sum(self._weight * (ratio - 1 - np.log(ratio))))

    def _solve(self, held: int | None = None, square: float = 0.0) -> Floats:
        """Squares of least deviance, with square `held` fixed: Fisher scoring by weighted non-negative least squares."""
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
            fitted = np.sqrt(new * fitted)  # half a step in the logarithm: a whole step may oscillate
        return squares
