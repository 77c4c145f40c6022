"""Calibration with one servo that turns at a known rate about a fixed axis, in several mountings of the device.

Source: Y. Li, L. Wang, Z. Wang, X. Li, S. W. Su, arXiv 2405.03393 and 2410.19571; method "[servomotor]" in Wang et al.
2024, with one change:

    source        u . K (m - b) = w      the servo's axis is vertical, and measured gravity gives its direction u
    this module   |K (m - b)| = w        the gyro itself gives the axis; no accelerometer is needed

In the source, an accelerometer offset of 90 mg turns u by 5° and more, which makes k 1 to 3 % too large. Letters:

    m_i   mean reading (3,) rad/s while the servo turns at the known rate w, rad/s
    g_i   K (m_i - b), rad/s, with K = diag(k), k (3,) scale factors;   u_i = g_i / |g_i|
    y_j   mean reading (3,) rad/s of rest j;   b  bias (3,) rad/s in the last rest
    f     residuals |g_i| - w and y_j - b, rad/s;   F  their derivatives by (b, k);   C  their covariance, (rad/s)²

C includes noise of the readings, bias wander, errors of the servo's rate, and axis misalignment E. The model sets E to
zero, although |g_i| = w (1 - u_i . E u_i).
The solver is Gauss-Newton, started from the squared equations, which are linear in k². The mountings need not follow
the sensor's axes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bridge.reasons.codes import Code, Sentences
from bridge.wire.messages import Verdict
from estimator.calibration.bias_wander import WanderKnobs, wander_cov
from estimator.calibration.capture import Floats, Samples
from estimator.calibration.constant_rates import Plateau, plateaus, said_of_others, split
from estimator.calibration.least_squares import Solved, shown_size, solve
from estimator.calibration.result import K_MAX, K_MIN, SCALE_STD, Result, concluded, nothing
from estimator.geometry.gyro_model import axis_names, reading_std

#: relative error of each spin's mean rate, within a factor of ten; estimated from the spins, up to the second number
_RATE_SHARE, _WORST_SHARE = 2e-4, 2e-2
#: rad, standard deviation of each misalignment element, which the model takes for zero
_MISALIGNMENT = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class _Evidence:
    """Mean readings of spins (s, 3) and rests (r, 3), rad/s, their variances, and the bias wander covariance (s + r, s + r).

    rate: the servo's rate, rad/s.
    """

    spin: Floats
    rest: Floats
    spin_var: Floats
    rest_var: Floats
    moved: Floats
    rate: float


def by_servomotor(samples: Samples, rates: tuple[float, ...], wander: WanderKnobs | None = None) -> Result:
    """Calibration method `servomotor`: scale factors (3,) and bias (3,) rad/s from a recording on a servo, with a verdict.

    rates: the servo's one rate, rad/s, used in either direction.
    wander: prior of the device's bias wander; by default that of the generic model.
    Verdict REFUSED: `rates` has more or less than one element, or a scale factor is outside 0.7 to 1.4. Also REFUSED:
    the chi-square of the turns' residuals over degrees of freedom is above 9.
    Verdict REPEAT: there is no rest, fewer than three suitable mountings, or a scale factor with a relative standard
    deviation of 0.02 or more.
    """
    wander = wander or WanderKnobs()
    if len(rates) != 1:
        return nothing("servomotor", Verdict.REFUSED, (Code.SERVO_RATES(given=len(rates)),))
    rests, turned, others = split(plateaus(samples), rates)
    if not rests:
        return nothing("servomotor", Verdict.REPEAT, (Code.SERVO_NO_REST(),), (0, 1, 2))
    rest = np.median([p.mean for p in rests], axis=0)
    spins: list[Plateau] = []
    for p in turned:
        k = rates[0] / float(np.linalg.norm(p.mean - rest))
        (spins if K_MIN < k < K_MAX else others).append(p)
    but = said_of_others(others)
    off = np.array([p.mean for p in spins]).reshape(-1, 3) - rest
    axis = off / np.linalg.norm(off, axis=1)[:, None]
    if len(spins) < 3 or np.linalg.svd(axis**2, compute_uv=False)[-1] < 0.1:
        return nothing("servomotor", Verdict.REPEAT, (Code.SERVO_TOO_FEW(spins=len(spins)), *but), (0, 1, 2))
    used = [*spins, *rests]
    evidence = _Evidence(
        spin=np.array([p.mean for p in spins]),
        rest=np.array([p.mean for p in rests]),
        spin_var=np.array([p.var for p in spins]),
        rest_var=np.array([p.var for p in rests]),
        moved=wander_cov(used, len(used) - 1, rests, wander),
        rate=rates[0],
    )
    share = shown_size(lambda share: _fit(evidence, share)[1], _RATE_SHARE, _WORST_SHARE)
    theta, fit = _fit(evidence, share)
    kept = Code.SERVO_DIAGONAL(spins=len(spins), percent=f"{100 * share:.2f}")
    return _judge(theta, fit, fit.misfit(slice(len(spins))), used, (kept, *but))


def _fit(of: _Evidence, share: float) -> tuple[Floats, Solved]:
    """Fit bias and scale factors (6,), and the last step of the fit; share: relative error of the servo's rate."""
    b = np.median(of.rest, axis=0)
    square, *_ = np.linalg.lstsq((of.spin - b) ** 2, np.full(len(of.spin), of.rate**2), rcond=None)
    theta = np.concatenate([b, np.sqrt(np.maximum(square, K_MIN**2))])
    for _ in range(10):
        solved = solve(*_linearised(of, theta, share))
        theta = theta + solved.step
        if solved.step_size < 1e-6:
            break
    return theta, solved


def _linearised(of: _Evidence, theta: Floats, share: float) -> tuple[Floats, Floats, Floats]:
    """Residuals (n,), slopes F (n, 6) and covariance C (n, n), n = s + 3 r, spins first."""
    b, k = theta[:3], theta[3:]
    s, r = len(of.spin), len(of.rest)
    g = k * (of.spin - b)
    size = np.linalg.norm(g, axis=1)
    u = g / size[:, None]
    by_bias = np.vstack([u * k, np.tile(np.eye(3), (r, 1))])
    stretch = np.concatenate([np.arange(s), np.repeat(s + np.arange(r), 3)])
    var = np.vstack([of.spin_var, of.rest_var])[stretch]
    F = np.zeros((s + 3 * r, 6))
    F[:, :3] = -by_bias
    F[:s, 3:] = u * (of.spin - b)
    C = (by_bias @ by_bias.T) * of.moved[np.ix_(stretch, stretch)] + np.diag(np.sum(by_bias**2 * var, axis=1))
    C[np.arange(s), np.arange(s)] += (share * of.rate) ** 2
    rows, columns = np.nonzero(1 - np.eye(3))
    askew = _MISALIGNMENT * of.rate * u[:, rows] * u[:, columns]
    C[:s, :s] += askew @ askew.T
    return np.concatenate([size - of.rate, (of.rest - b).ravel()]), F, C


def _judge(theta: Floats, fit: Solved, misfit: float, used: Sequence[Plateau], reason: Sentences) -> Result:
    b, k = theta[:3], theta[3:]
    covariance = misfit * fit.cov
    loose = tuple(axis for axis in range(3) if not covariance[3 + axis, 3 + axis] ** 0.5 < SCALE_STD * k[axis])
    contradicts = Verdict.REFUSED, (), (*reason, Code.SERVO_MISFIT(times=f"{misfit**0.5:.0f}"))
    unsure = Verdict.REPEAT, loose, (Code.MOUNTINGS_UNCERTAIN(axes=axis_names(loose)),)
    verdict, repeat, reason = concluded(k, reason, contradicts if misfit > 9.0 else None, unsure if loose else None)
    noise_std = reading_std(np.median([p.std for p in used], axis=0))
    time = (used[-1].start + used[-1].end) / 2
    return Result("servomotor", verdict, reason, np.diag(k), b, covariance, noise_std, (), repeat, time)
