"""Gyro model: corrected rate = matrix (reading - bias), rates in rad/s. The bias is the reading at zero rate."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from math import radians, sqrt

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
AXES = "xyz"
#: standard deviations in every ± shown to users: 95 % of a normal distribution
SIGMAS = 1.96
#: rounding step, rad/s, assumed for a gyro whose readings never differ: 2000 °/s in 16 bits
COARSE_STEP = radians(0.061)


def axis_names(axes: Iterable[int]) -> str:
    """Format axis numbers (0 to 2) as names: `x, z`."""
    return ", ".join(AXES[axis] for axis in axes)


def least_step(reading: Floats) -> Floats:
    """Rounding step (3,) of readings (n, 3), rad/s: the smallest difference above 1e-9 between readings on each axis.

    The step is close to zero on an axis with unrounded readings. On an axis whose readings are all equal, the step is
    COARSE_STEP, rad/s.
    """
    ordered = np.sort(reading.T)
    steps = ordered[:, 1:] - ordered[:, :-1]
    steps[steps <= 1e-9] = np.inf
    least: Floats = np.minimum.reduce(steps, axis=1, initial=np.inf)
    least[np.isinf(least)] = COARSE_STEP
    return least


def rounding_var(std: Floats, step: Floats) -> Floats:
    """Variance (3,) that rounding adds to the mean of readings at rest: step² / 12 if std < step / 2, else 0.

    std (3,): standard deviation of a reading. step (3,): rounding step, in the same unit. The variance is in the
    square of this unit.
    If the noise is small, every reading has the same rounding error, which averaging does not reduce. Larger noise
    makes the rounding errors independent, so that they average out.
    """
    return np.where(std < step / 2, step**2 / 12, 0.0)


def mean_var(std: Floats, step: Floats, n: float) -> Floats:
    """Variance (3,) of the mean of n readings at rest, from noise and rounding.

    std (3,): standard deviation of a reading. step (3,): rounding step, in the same unit. The variance is in the
    square of this unit.
    """
    return std**2 / n + rounding_var(std, step)


def reading_std(std: Floats) -> Floats:
    """Standard deviation (3,) of one gyro reading, rad/s, from the standard deviation (3,) observed at rest, rad/s.

    A coarse gyro may show no noise at rest. The result is then that of rounding: COARSE_STEP / √12, rad/s.
    """
    if all(axis > 1e-9 for axis in std.tolist()):
        return std
    return np.where(std > 1e-9, std, COARSE_STEP / np.sqrt(12))


def corrected(reading: Floats, matrix: Floats, bias: Floats) -> Floats:
    """Corrected rates (n, 3) rad/s of gyro readings (n, 3) rad/s, in sensor axes: matrix (reading - bias).

    matrix (3, 3) and bias (3,), rad/s, apply to all readings; matrix (n, 3, 3) and bias (n, 3) give each reading its
    own.
    The result is bit-identical for any number of readings at once, which a matrix product does not guarantee.
    """
    off = reading - bias
    return matrix[..., 0] * off[:, 0:1] + matrix[..., 1] * off[:, 1:2] + matrix[..., 2] * off[:, 2:3]


@dataclass(frozen=True, slots=True, eq=False)
class GyroModel:
    """Calibration of a gyro with its uncertainty, in sensor axes.

    matrix (3, 3): no unit. bias (3,): rad/s.
    noise_std (3,): standard deviation of one reading, rad/s.
    The true matrix is (1 + E) matrix; E (3, 3) is the relative error, without unit.
    scale_std (3,): standard deviation of the diagonal elements of E.
    cross_std (3,): standard deviation of the off-diagonal elements of E, one value per row.
    """

    matrix: Floats
    bias: Floats
    scale_std: Floats
    cross_std: Floats
    noise_std: Floats

    def correct(self, reading: Floats) -> Floats:
        """Corrected rates (n, 3) of readings (n, 3), rad/s, in sensor axes."""
        return corrected(reading, self.matrix, self.bias)

    def corrected_std(self, reading_std: Floats) -> Floats:
        """Standard deviation (…, 3) rad/s of the corrected rate from independent errors of the reading.

        reading_std (…, 3) rad/s: standard deviations of these errors.
        """
        return np.asarray(np.sqrt(np.square(reading_std) @ np.square(self.matrix).T))


@dataclass(frozen=True, slots=True)
class PriorKnobs:
    """Prior standard deviations of a gyro not yet calibrated in this boot.

    scale_std: of a scale factor, relative to that of the datasheet. misalignment_std: rad. bias_std: rad/s.
    noise_std: of one reading, rad/s.
    """

    #: relative, of the datasheet's sensitivity: known library errors reach 0.17
    scale_std: float = 0.15
    #: rad, of one axis of the chip relative to the others
    misalignment_std: float = 0.01
    #: turn-on bias of a low-cost part, rad/s
    bias_std: float = radians(5.0)
    noise_std: float = radians(0.15)


def repeatability(scales: Sequence[Floats], knobs: PriorKnobs) -> float:
    """Standard deviation of the relative change of a device's scale factors between consecutive boots, without unit.

    scales (n, 3): calibrated scale factors of n consecutive boots, without unit. With n of 0 or 1 the result is
    `knobs.scale_std`.
    Method: the result squared is the mean of the squared changes of log scale, over all boots and axes. The prior
    knobs.scale_std² counts as one more squared change. This is the scale parameter of the variance's posterior, a
    scaled inverse χ² distribution (A. Gelman et al., "Bayesian Data Analysis", 3rd ed. (2013), 2.6).
    """
    moved = np.diff(np.log(np.reshape(scales, (-1, 3))), axis=0)
    return sqrt((knobs.scale_std**2 + float(np.square(moved).sum())) / (1 + moved.size))


@cache
def uncalibrated(knobs: PriorKnobs) -> GyroModel:
    """Prior gyro model from the datasheet: scale 1, bias 0 rad/s, with the prior standard deviations.

    All callers share the cached result: do not write to its arrays.
    """
    scale, cross, noise = (np.full(3, std) for std in (knobs.scale_std, knobs.misalignment_std, knobs.noise_std))
    return GyroModel(np.eye(3), np.zeros(3), scale, cross, noise)
