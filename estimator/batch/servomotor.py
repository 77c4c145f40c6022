"""Calibration with one servo whose axis is vertical: gravity, measured at rest, and rate, measured at speed, agree.

Source: the method of the paper's own group, its "[servomotor]": Y. Li, L. Wang, Z. Wang, X. Li, S. W. Su, arXiv 2405.03393
and 2410.19571: the dot product of measured gravity and rotation rate is constant in a fixed frame, so that the scale
factors follow from linear least squares. As far as the abstracts tell; the weights and the covariance are ours. Letters:

    u_i   direction of gravity in the sensor at mounting i, at rest; the servo's axis, up to its sign
    m_i   mean reading while it turned at the known rate w_i;  u_i . K (m_i - b) = w_i,  K = diag(k):  linear in k
    b     mean reading at rest

Mountings need not follow the sensor's axes: three that differ are enough. Misalignment is taken for zero, as in the source;
what it may be widens the covariance.
"""

from dataclasses import dataclass
from math import degrees, radians

import numpy as np

from bridge.wire.messages import Verdict
from estimator.batch.capture import Floats, Samples
from estimator.batch.gravity import G
from estimator.batch.plateaus import Plateau, plateaus, still
from estimator.batch.result import Result, VerdictKnobs, nothing, unbelievable
from estimator.batch.stages import LEAST_GRAVITY, MOST_GRAVITY
from estimator.gyro import AXES, reading_std


@dataclass(frozen=True, slots=True)
class ServoKnobs:
    """How good the servo is, and what the model leaves out."""

    #: relative error of its rate
    rate_share: float = 5e-4
    #: rad, misalignment of the gyro's axes, taken for zero
    misalignment: float = 0.01
    #: rad/s, by which the bias differs from rest to rest
    bias_floor: float = radians(0.003)


def by_servomotor(samples: Samples, rates: tuple[float, ...], knobs: ServoKnobs | None = None) -> Result:
    """Scale factors and bias from a recording on a servo with a vertical axis; its one rate in rad/s, used either way."""
    knobs = knobs or ServoKnobs()
    if samples.accel is None:
        return _refused("no accelerometer: the servo's axis is seen as gravity's direction")
    if len(rates) != 1:
        return _refused(f"a servo turns at one known rate; {len(rates)} were given")
    found = plateaus(samples)
    rests, spins = [p for p in found if still(p, rates)], [p for p in found if not still(p, rates)]
    pairs = [(spin, rest) for spin in spins if (rest := _rest_before(spin, rests)) is not None]
    u = np.array([rest.accel for _, rest in pairs]).reshape(-1, 3)
    size = np.linalg.norm(u, axis=1)
    if np.any((size < LEAST_GRAVITY) | (size > MOST_GRAVITY)):
        far = size[np.argmax(np.abs(size - G))]
        return _refused(f"{far:.1f} m/s² at rest is no gravity: the servo's axis is seen as its direction")
    u /= size[:, None]
    if len(pairs) < 3 or np.linalg.svd(u**2, compute_uv=False)[-1] < 0.1:
        reason = f"{len(pairs)} stretches of constant rate after a rest: three mountings that differ are needed"
        return nothing("servomotor", Verdict.REPEAT, f"{reason}, 1.5 s of each", (0, 1, 2))
    b, b_cov = _bias(rests, knobs)
    A = u * (np.array([spin.mean for spin, _ in pairs]) - b)
    w = np.sign(A.sum(axis=1)) * rates[0]
    noise = np.array([u_i**2 @ spin.var for u_i, (spin, _) in zip(u, pairs, strict=True)])
    std = np.sqrt(noise + (knobs.rate_share * w) ** 2)
    k, *_ = np.linalg.lstsq(A / std[:, None], w / std, rcond=None)
    gain = np.linalg.pinv(A / std[:, None]) / std
    missed = w - A @ k
    # Each off-diagonal element of M, left out, adds its u_row u_column w to every equation.
    rows, columns = np.nonzero(1 - np.eye(3))
    askew = knobs.misalignment * w[:, None] * u[:, rows] * u[:, columns]
    left_out = gain @ askew
    by_bias = gain @ (u * k)
    var = std**2 + np.sum(askew**2, axis=1) + (u * k) ** 2 @ np.diag(b_cov)
    misfit = float(np.sum(missed**2 / var)) / max(len(missed) - 3, 1)
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = b_cov
    covariance[3:, :3] = by_bias @ b_cov
    covariance[:3, 3:] = covariance[3:, :3].T
    of_spins = (gain * std**2) @ gain.T + left_out @ left_out.T
    covariance[3:, 3:] = max(misfit, 1.0) * of_spins + by_bias @ b_cov @ by_bias.T
    return _judge(k, b, covariance, missed, misfit, [*spins, *rests])


def _refused(reason: str) -> Result:
    return nothing("servomotor", Verdict.REFUSED, reason)


def _rest_before(spin: Plateau, rests: list[Plateau]) -> Plateau | None:
    before = [rest for rest in rests if rest.end <= spin.start and spin.start - rest.end < 5.0]
    return before[-1] if before else None


def _bias(rests: list[Plateau], knobs: ServoKnobs) -> tuple[Floats, Floats]:
    weight = 1 / (np.array([rest.var for rest in rests]) + knobs.bias_floor**2)
    mean = (weight * [rest.mean for rest in rests]).sum(axis=0) / weight.sum(axis=0)
    return mean, np.diag(1 / weight.sum(axis=0))


def _judge(k: Floats, b: Floats, covariance: Floats, missed: Floats, misfit: float, used: list[Plateau]) -> Result:
    bad, limits = unbelievable(k, VerdictKnobs()), VerdictKnobs()
    loose = tuple(axis for axis in range(3) if not covariance[3 + axis, 3 + axis] ** 0.5 < limits.scale_std * k[axis])
    rms = degrees(float(np.sqrt(np.mean(missed**2))))
    verdict = Verdict.ACCEPTED
    repeat: tuple[int, ...] = ()
    reason = f"diagonal from {len(missed)} spins, whose known rate was met to {rms:.3f} °/s rms"
    if bad is not None:
        verdict, repeat, reason = Verdict.REFUSED, *bad
    elif misfit > 9.0:
        verdict = Verdict.REFUSED
        reason += f", {misfit**0.5:.0f} times worse than a servo errs: is it the one rate of all of them?"
    elif loose:
        verdict, repeat = Verdict.REPEAT, loose
        names = ", ".join(AXES[axis] for axis in loose)
        reason = f"the mountings leave the scale of {names} uncertain: mount it with {names} upright too"
    noise_std = reading_std(np.median([p.std for p in used], axis=0))
    time = float(np.mean([(p.start + p.end) / 2 for p in used]))
    return Result("servomotor", verdict, reason, np.diag(k), b, covariance, noise_std, (), repeat, time)
