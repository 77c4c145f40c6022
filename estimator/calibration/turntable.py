"""Turntable calibration by known rates in both directions about each axis in turn; linear least squares.

Source: IEEE Std 952, the rate test of a triad; the six-rate comparison method in Wang et al. 2024. Letters:

    s_i   true rate (3,) rad/s of plateau i: the known rate about the axis that reads most, with the reading's sign;
          0 for a rest
    m_i   mean reading (3,) rad/s
    M, b  gyro matrix (3, 3), no unit, and bias (3,) rad/s in the last rest
    c     M b, rad/s: s_i = M m_i - c is linear in M (9 elements) and c (3)
    C     covariance of the equations, (rad/s)²

C has four parts: noise of the readings, bias wander, errors of the table's rate, and the angle of the device's fixing.
The angle is the same for all plateaus of one fixing. Through the bias wander, least squares interpolates the bias
between rests.
The matrix refers to the axes of the fixture. If the device is not square in its fixture, the matrix includes that
misalignment.
"""

from collections.abc import Sequence
from math import cos, degrees, radians

import numpy as np
from numpy.typing import NDArray

from bridge.reasons.codes import Code, Sentences
from bridge.wire.messages import Verdict
from estimator.calibration.bias_wander import WanderKnobs, wander_cov
from estimator.calibration.capture import Floats, Samples
from estimator.calibration.constant_rates import Plateau, nearest_rates, plateaus, said_of_others, split
from estimator.calibration.gravity_propagation import COLUMN, MATRIX_PARAMETERS, ROW
from estimator.calibration.least_squares import Solved, shown_size, solve
from estimator.calibration.result import Result, concluded, nothing
from estimator.geometry.gyro_model import axis_names, reading_std

#: relative error of each stretch's mean rate, within a factor of ten; estimated from the stretches, up to the second number
_RATE_SHARE, _WORST_SHARE = 3e-5, 5e-4
#: rad, angle between the device's fixing and the table's axis
_SQUARE = radians(0.1)
#: rad, largest angle between a rate and the axis it is assigned to
_OFF_AXIS = radians(20.0)


def by_turntable(samples: Samples, rates: tuple[float, ...], wander: WanderKnobs | None = None) -> Result:
    """Calibration method `turntable`: matrix (3, 3) and bias (3,) rad/s from a recording on a turntable, with verdict.

    rates: known rates, rad/s, each used in both directions.
    wander: prior of the device's bias wander; by default that of the generic model.
    Verdict REPEAT: an axis was not turned in both directions.
    Verdict REFUSED: a given rate is not found, a scale factor is outside 0.7 to 1.4, or the residuals' chi-square over
    degrees of freedom is above 4.
    """
    wander = wander or WanderKnobs()
    rests, turned, others = split(plateaus(samples), rates)
    true = _true_rates(turned, rests, rates)
    met = np.asarray(true.any(axis=1))
    others += [p for p, is_met in zip(turned, met, strict=True) if not is_met]
    spins, true, but = [p for p, is_met in zip(turned, met, strict=True) if is_met], true[met], said_of_others(others)
    missing = tuple(axis for axis in range(3) if set(np.sign(true[:, axis])) - {0.0} != {-1.0, 1.0})
    if missing:
        one_way = Code.TABLE_ONE_WAY(spins=len(spins), axes=axis_names(missing))
        return nothing("turntable", Verdict.REPEAT, (one_way, *but), missing)
    # Stretches are left over and a given rate is not met: that rate is probably wrong.
    unmet = [rate for rate in rates if not np.all(np.any(np.abs(true) == rate, axis=0))]
    if unmet and others:
        names = ", ".join(f"{degrees(rate):g}" for rate in unmet)
        return nothing("turntable", Verdict.REFUSED, (Code.TABLE_RATE_MISSING(rates_dps=names), *but))
    used = sorted([*spins, *rests], key=lambda p: p.start)
    s = np.zeros((len(used), 3))
    s[[used.index(p) for p in spins]] = true
    reference = used.index(rests[-1]) if rests else len(used) - 1
    moved = wander_cov(used, reference, rests, wander)
    share = shown_size(lambda share: _fit(used, s, moved, share), _RATE_SHARE, _WORST_SHARE)
    fit = _fit(used, s, moved, share)
    # A wrong rate shows in the misfit of the rates along the axes alone.
    misfit = max(fit.misfit(), fit.misfit((s != 0).T.ravel()))
    kept = Code.TABLE_MATRIX(spins=len(spins), percent=f"{100 * share:.3f}")
    return _judge(fit, misfit, used, reference, (kept, *but))


def _true_rates(spins: Sequence[Plateau], rests: Sequence[Plateau], rates: tuple[float, ...]) -> Floats:
    """True rate (n, 3) of each stretch that turned; 0 where none of the given rates about one axis explains it."""
    true = np.zeros((len(spins), 3))
    if not spins:
        return true
    mean = np.array([p.mean for p in spins])
    # Without rests: the middle between the two directions.
    rest = np.median([p.mean for p in rests], axis=0) if rests else (mean.max(axis=0) + mean.min(axis=0)) / 2
    off = mean - rest
    about = np.argmax(np.abs(off), axis=1)
    reading = off[np.arange(len(off)), about]
    straight = np.abs(reading) > cos(_OFF_AXIS) * np.linalg.norm(off, axis=1)
    for axis in range(3):
        own = straight & (about == axis)
        if own.any():
            true[own, axis] = np.sign(reading[own]) * nearest_rates(np.abs(reading[own]), rates)
    return true


def _fit(used: Sequence[Plateau], s: Floats, moved: Floats, share: float) -> Solved:
    """Fit M and c, row by row (12,), from zero; share: relative error of the table's rate."""
    m, n = np.array([p.mean for p in used]), len(used)
    # The weights need only an approximate scale factor: the ratio of rates.
    k = np.array([np.sum(s[:, a] ** 2) / np.sum(s[:, a] * m[:, a]) for a in range(3)])
    design = np.kron(np.eye(3), np.column_stack([m, -np.ones(n)]))
    return solve(s.T.ravel(), -design, _covariance(used, s, k, moved, share))


def _covariance(used: Sequence[Plateau], s: Floats, k: Floats, moved: Floats, share: float) -> Floats:
    """Covariance (3n, 3n) of the equations, those of the x axis first."""
    n = len(used)
    var = np.array([p.var for p in used]) * k**2 + (share * s) ** 2
    C = np.diag(var.T.ravel()) + np.kron(np.diag(k**2), moved)
    # A fixing off by a small rotation e turns the true rate s into s + e x s.
    fixing = _fixings(s)
    for mount in range(fixing.max() + 1):
        cross = np.zeros((3 * n, 3))
        for i in np.flatnonzero(fixing == mount):
            x, y, z = s[i]
            cross[[i, n + i, 2 * n + i]] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
        C += _SQUARE**2 * cross @ cross.T
    return C


def _fixings(s: Floats) -> NDArray[np.int64]:
    """Number (n,) of each stretch's fixing: a new one whenever the axis changes."""
    about = np.where(s.any(axis=1), np.argmax(np.abs(s), axis=1), -1)
    number, last, mounts = 0, -1, []
    for axis in about.tolist():
        number += axis >= 0 and last not in (-1, axis)
        last = axis if axis >= 0 else last
        mounts.append(number)
    return np.array(mounts)


def _judge(fit: Solved, misfit: float, used: Sequence[Plateau], reference: int, reason: Sentences) -> Result:
    M, c = fit.step.reshape(3, 4)[:, :3], fit.step.reshape(3, 4)[:, 3]
    bias = np.asarray(np.linalg.solve(M, c))
    # bias = M⁻¹ c, so its error is M⁻¹ (error of c - error of M · bias).
    inverse = np.linalg.inv(M)
    J = np.zeros((12, 12))
    for row in range(3):
        J[:3, 4 * row : 4 * row + 3] = -np.outer(inverse[:, row], bias)
        J[:3, 4 * row + 3] = inverse[:, row]
    J[3 + np.arange(9), 4 * ROW + COLUMN] = 1.0
    covariance = misfit * J @ fit.cov @ J.T
    noise_std = reading_std(np.median([p.std for p in used], axis=0))
    contradicts = Verdict.REFUSED, (), (*reason, Code.TABLE_MISFIT(times=f"{misfit**0.5:.0f}"))
    verdict, repeat, reason = concluded(np.diag(M), reason, contradicts if misfit > 4.0 else None)
    time = (used[reference].start + used[reference].end) / 2
    return Result("turntable", verdict, reason, M, bias, covariance, noise_std, (), repeat, time, MATRIX_PARAMETERS)
