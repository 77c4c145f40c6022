"""Rotation path of a gyro between two rests, with the sensitivity of its end attitude to the gyro's parameters.

A small rate error delta(t) (rad/s), in sensor axes, moves the end attitude R to exp(phi) R. The rotation phi is sum C
delta dt (rad). C is the attitude in the middle of each sample interval dt (s). It rotates the error into the frame of
the start.
"""

from dataclasses import dataclass

import numpy as np

from estimator.calibration.capture import Floats, Samples
from estimator.geometry import rotation


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Path of a movement: end attitude (3, 3), and its sensitivity to the gyro's parameters.

    end (3, 3): rotates vectors from the device axes at the end into those at the start.
    Sensitivities are of phi, a small rotation of the end in the start frame, rad.
    by_matrix (3, 3, 3): phi per element of the matrix, rad.
    by_bias (3, 3): phi per rad/s of bias, s.
    noise (3, 3): covariance of phi from the white noise of the readings, rad².
    way: total angle turned, in both directions, rad. seconds: duration, s.
    coning: sum of the magnitudes of the coning corrections of all sample intervals, rad. It measures how much the
        rotation axis moves between samples, and so the size of the integration error.
    """

    end: Floats
    by_matrix: Floats
    by_bias: Floats
    noise: Floats
    way: float
    seconds: float
    coning: float


def integrate(samples: Samples, matrix: Floats, bias: Floats, noise_std: Floats) -> Path:
    """Integrate the gyro samples of a movement into a rotation path, with its sensitivities and noise.

    matrix (3, 3), bias (3,) rad/s: the calibration, rate = matrix (reading - bias).
    noise_std (3,): standard deviation of the white noise of one reading, rad/s.
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
