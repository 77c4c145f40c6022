"""Accelerometer calibration from rests in different poses: bias and scale per axis, so that every rest reads gravity.

    |scale * (reading - bias)| = G      in every pose, by weighted least squares (Gauss-Newton)

reading and bias: (3,) m/s² in sensor axes. scale: (3,), no unit. G: 9.80665 m/s².
Local gravity differs from G by up to 0.3 %; the scale absorbs this difference. Cross-axis sensitivity is not estimated.
Its size is estimated from the residuals and enters the covariance.
Source: I. Frosio, F. Pedersini, N. A. Borghese, "Autocalibration of MEMS accelerometers", IEEE Transactions on
Instrumentation and Measurement 58 (2009), with bias and scale only.
"""

import numpy as np

from bridge.reasons.codes import Code, Sentence
from bridge.wire.messages import AccelerometerCalibration, Verdict
from estimator.calibration.accelerometer_errors import AccelKnobs, G
from estimator.calibration.capture import Floats
from estimator.calibration.least_squares import Solved, shown_size, solve

#: six unknowns
FEWEST_POSES = 6
_STEPS = 5

#: m/s², standard deviation of a rest's error beside its noise: a wearer's breath, hysteresis, bias instability
_REST_STD = 0.01
#: largest cross-axis sensitivity: share of one axis's acceleration in the reading of another
_ACROSS = 0.02
#: m/s² and relative: a greater standard deviation means that the poses do not determine an axis
_BIAS_STD, _SCALE_STD = 0.05, 0.01
#: m/s² and relative: greater errors are no accelerometer's
_BIAS, _SCALE = 1.5, 0.1
#: largest ratio of the residuals' variance to the variance that the assumed errors explain
_MISFIT = 9.0


def calibrated(poses: Floats) -> AccelerometerCalibration:
    """Calibrate an accelerometer from rests in n poses: bias (3,) m/s² and scale (3,), with covariance and verdict.

    poses (n, 4): in each row the variance of the mean reading, m²/s⁴ per axis, then the mean reading (3,), m/s².
    The covariance is (6, 6), flattened, in the order bias, scale.
    Verdict REPEAT: fewer than six poses, or a standard deviation above 0.05 m/s² (bias) or 0.01 (scale).
    Verdict REFUSED: |bias| of an axis above 1.5 m/s², or a scale more than 0.1 from 1. Also REFUSED: a chi-square of
    the residuals over its degrees of freedom above 9.
    A result with verdict REPEAT or REFUSED has no estimate.
    """
    told, n = AccelKnobs().shear, len(poses)
    if n < FEWEST_POSES:
        return _without(Verdict.REPEAT, n, Code.TOO_FEW_POSES(poses=n, least=FEWEST_POSES))
    bias, scale = np.zeros(3), np.ones(3)
    try:
        for _ in range(_STEPS):
            step = _solved(poses, bias, scale, told).step
            bias, scale = bias + step[:3], scale + step[3:]
        across = shown_size(lambda size: _solved(poses, bias, scale, size), told, _ACROSS)
        found = _solved(poses, bias, scale, across)
    except np.linalg.LinAlgError:
        return _without(Verdict.REPEAT, n, Code.ACCELEROMETER_UNCERTAIN())
    bias, scale = bias + found.step[:3], scale + found.step[3:]
    misfit = found.misfit()
    covariance = misfit * found.cov
    std = np.sqrt(covariance.diagonal())
    if not (std[:3].max() < _BIAS_STD and std[3:].max() < _SCALE_STD):
        return _without(Verdict.REPEAT, n, Code.ACCELEROMETER_UNCERTAIN())
    if not (np.abs(bias).max() < _BIAS and np.abs(scale - 1).max() < _SCALE):
        strength = np.linalg.norm(poses[:, 1:], axis=1)
        worst = strength[np.argmax(np.abs(strength - G))]
        return _without(Verdict.REFUSED, n, Code.ACCELEROMETER_NOT_GRAVITY(reading_m_s2=f"{worst:.1f}"))
    if misfit > _MISFIT:
        return _without(Verdict.REFUSED, n, Code.ACCELEROMETER_MISFIT(times=f"{misfit**0.5:.1f}"))
    return AccelerometerCalibration(
        Verdict.ACCEPTED,
        (Code.ACCELEROMETER_CALIBRATED(poses=n),),
        n,
        tuple(bias.tolist()),
        tuple(scale.tolist()),
        tuple(covariance.ravel().tolist()),
        across,
    )


def in_use(known: AccelerometerCalibration) -> Floats:
    """Pack an accepted accelerometer calibration into one array (9,): bias (3) m/s², scale (3), standard deviation (3) m/s².

    known: the accepted calibration.
    The standard deviation is that of a corrected reading of gravity, per axis, as an rms over all poses. It includes
    the errors of bias, scale and cross-axis sensitivity.
    """
    var = np.diag(np.reshape(known.covariance, (6, 6)))
    error = var[:3] + G**2 / 3 * (var[3:] + 2 * known.cross_std**2)
    return np.array([*known.bias, *known.scale, *np.sqrt(error)])


def _solved(poses: Floats, bias: Floats, scale: Floats, across: float) -> Solved:
    """A step of bias and scale; what axes take from each other (std `across`) correlates the residuals."""
    from_bias = poses[:, 1:] - bias
    gravity = scale * from_bias
    strength = np.linalg.norm(gravity, axis=1)
    up = gravity / strength[:, None]
    slopes = np.column_stack([-scale * up, from_bias * up])
    taken = from_bias[:, [1, 0, 0]] * up[:, [2, 2, 1]] + from_bias[:, [2, 2, 1]] * up[:, [1, 0, 0]]
    noise = np.diag(poses[:, 0] + _REST_STD**2)
    return solve(strength - G, slopes, noise + across**2 * taken @ taken.T)


def _without(verdict: Verdict, poses: int, why: Sentence) -> AccelerometerCalibration:
    return AccelerometerCalibration(verdict, (why,), poses)
