"""The model of a gyro: corrected = matrix (reading - bias), with the bias the reading at zero rate."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from math import radians, sqrt

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
AXES = "xyz"
#: a ± that people are shown is so many standard deviations: 95 % of a normal distribution
SIGMAS = 1.96
#: least step, rad/s, taken for a gyro whose readings never differ: 2000 °/s in 16 bits
COARSE_STEP = radians(0.061)


def axis_names(axes: Iterable[int]) -> str:
    """Axes by name: `x, z`."""
    return ", ".join(AXES[axis] for axis in axes)


def spread(reading: Floats) -> tuple[Floats, Floats]:
    """Mean (3,) and standard deviation (3,) of readings (n, 3), n > 1; in a third of NumPy's own time for few readings."""
    n = len(reading)
    mean: Floats = np.add.reduce(reading) / n
    off = reading - mean
    return mean, np.sqrt(np.add.reduce(off * off) / (n - 1))


def least_step(reading: Floats) -> Floats:
    """(3,) least difference between readings (n, 3); next to nothing where they are not rounded."""
    ordered = np.sort(reading.T)
    steps = ordered[:, 1:] - ordered[:, :-1]
    steps[steps <= 1e-9] = np.inf
    least: Floats = np.minimum.reduce(steps, axis=1, initial=np.inf)
    least[np.isinf(least)] = COARSE_STEP
    return least


def rounding_var(std: Floats, step: Floats) -> Floats:
    """(3,) variance of what rounding to a step (3,) leaves in a mean of readings at rest with deviation std (3,).

    Noise well below the step leaves the same error in all of them: averaging does not lessen it.
    """
    return np.where(std < step / 2, step**2 / 12, 0.0)


def mean_var(std: Floats, step: Floats, n: float) -> Floats:
    """(3,) variance of the mean of n readings at rest with standard deviation std (3,), rounded to a step (3,)."""
    return std**2 / n + rounding_var(std, step)


def reading_std(std: Floats) -> Floats:
    """(3,) standard deviation of a reading, from the one shown at rest: a coarse gyro may show none, and rounds."""
    if all(axis > 1e-9 for axis in std.tolist()):
        return std
    return np.where(std > 1e-9, std, COARSE_STEP / np.sqrt(12))


def corrected(reading: Floats, matrix: Floats, bias: Floats) -> Floats:
    """(n, 3) corrected rates of readings (n, 3) by a matrix (3, 3) and a bias (3,), or (n, 3, 3) and (n, 3), a row each.

    The same to the last bit however many are corrected at once, which no matrix product promises.
    """
    off = reading - bias
    return matrix[..., 0] * off[:, 0:1] + matrix[..., 1] * off[:, 1:2] + matrix[..., 2] * off[:, 2:3]


@dataclass(frozen=True, slots=True, eq=False)
class GyroModel:
    """What is known of a gyro: matrix (3, 3), bias (3,) rad/s; noise_std (3,) rad/s of a reading.

    scale_std (3,), relative, is that of the matrix's diagonal; cross_std (3,), relative, that of the others of each row.
    """

    matrix: Floats
    bias: Floats
    scale_std: Floats
    cross_std: Floats
    noise_std: Floats

    def correct(self, reading: Floats) -> Floats:
        """(n, 3) corrected rates of readings (n, 3), rad/s, sensor frame."""
        return corrected(reading, self.matrix, self.bias)

    def corrected_std(self, reading_std: Floats) -> Floats:
        """(…, 3) standard deviation that independent errors of the reading (…, 3) leave in the corrected rate."""
        return np.asarray(np.sqrt(np.square(reading_std) @ np.square(self.matrix).T))


@dataclass(frozen=True, slots=True)
class PriorKnobs:
    """What is believed of a gyro before it has been calibrated in this boot."""

    #: a datasheet's sensitivity is trusted this far (relative): known library errors reach 0.17
    scale_std: float = 0.15
    #: an axis of the chip against the others, rad
    misalignment_std: float = 0.01
    #: turn-on bias of a low-cost part, rad/s
    bias_std: float = radians(5.0)
    noise_std: float = radians(0.15)


def repeatability(scales: Sequence[Floats], knobs: PriorKnobs) -> float:
    """How far the scale factors of a device move from one boot to the next (relative standard deviation), by boots in a row.

    scales (n, 3): as each was calibrated; none or one tells no more than of what kind it is.
    Source: the scale of a scaled inverse χ² posterior of the variance, all axes alike, what is believed before being worth one of
    them (A. Gelman et al., "Bayesian Data Analysis", 3rd ed. (2013), 2.6).
    """
    moved = np.diff(np.log(np.reshape(scales, (-1, 3))), axis=0)
    return sqrt((knobs.scale_std**2 + float(np.square(moved).sum())) / (1 + moved.size))


@cache
def uncalibrated(knobs: PriorKnobs) -> GyroModel:
    """The datasheet's word: scale 1, bias 0, and how little that is worth. The same for all; not to be written to."""
    scale, cross, noise = (np.full(3, std) for std in (knobs.scale_std, knobs.misalignment_std, knobs.noise_std))
    return GyroModel(np.eye(3), np.zeros(3), scale, cross, noise)
