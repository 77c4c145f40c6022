"""Rotation path of a gyro between two rests, with the sensitivity of its end to the gyro's parameters.

A small error of the rates, delta(t) in the device's axes, moves the end attitude R to exp(phi) R, where
phi = sum C delta dt. C is the attitude in the middle of each sample's interval; it takes the error to the frame of the start.
"""

from dataclasses import dataclass

import numpy as np

from estimator.calibration.capture import Floats, Samples
from estimator.geometry import rotation


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Path of a movement: end (3, 3) takes vectors from axes of the last attitude to axes of the first.

    phi, rad: small rotation of the end by an error of the gyro's parameters, in axes of the first attitude. by_matrix
    (3, 3, 3): phi per element of the matrix. by_bias (3, 3): phi per rad/s of bias. noise (3, 3), rad²: covariance of
    phi from the readings' white noise. way: rad turned in total, in both directions. seconds: duration. coning: rad by
    which the axis of rotation moved within the samples' intervals, summed without sign; a part of it is the error from
    unknown motion between samples.
    """

    end: Floats
    by_matrix: Floats
    by_bias: Floats
    noise: Floats
    way: float
    seconds: float
    coning: float


def integrate(samples: Samples, matrix: Floats, bias: Floats, noise_std: Floats) -> Path:
    """Integrate the samples of a movement into a rotation path, with its sensitivities and noise.

    matrix (3, 3), bias (3,) rad/s: the calibration. noise_std (3,) rad/s: white noise of one reading.
    """
    dt = rotation.intervals(samples.time)
    reading = samples.gyro - bias
    rate = reading @ matrix.T
    attitude = rotation.attitudes(rate, dt)
    # The mean of two attitudes is the attitude midway, to second order in a step.
    mid = 0.5 * (attitude[:-1] + attitude[1:])
    by_reading = (mid @ matrix) * dt[:, None, None]
    spread = by_reading * noise_std
    steps = rate * dt[:, None]
    return Path(
        end=attitude[-1],
        by_matrix=np.einsum("tik,tl,t->ikl", mid, reading, dt),
        by_bias=-by_reading.sum(axis=0),
        noise=np.einsum("tij,tkj->ik", spread, spread),
        way=float(np.linalg.norm(steps, axis=1).sum()),
        seconds=float(dt.sum()),
        coning=float(np.linalg.norm(np.cross(steps[:-1], steps[1:]), axis=1).sum()) / 12,
    )
