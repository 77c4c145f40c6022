"""Rotations of a body from its rates. Attitudes are 3x3 matrices that take body vectors to the frame the body started in."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]


def intervals(time: Floats) -> Floats:
    """(n,) seconds each sample stands for: a sample holds over the interval that ends at it; the first as the median."""
    steps = np.diff(time)
    first = np.median(steps) if len(steps) else 0.0
    return np.concatenate([[first], steps])


def attitudes(rate: Floats, dt: Floats) -> Floats:
    """(n + 1, 3, 3) attitudes from rates (n, 3) rad/s held for dt (n,) s, by Rodrigues products from the identity."""
    steps = Rotation.from_rotvec(rate * dt[:, None]).as_matrix()
    result = np.empty((len(rate) + 1, 3, 3))
    attitude = np.eye(3)
    result[0] = attitude
    for i, step in enumerate(steps):
        attitude = attitude @ step
        result[i + 1] = attitude
    return result


def log(attitude: Floats) -> Floats:
    """(3,) rotation vector of an attitude (3, 3), of length 0 to pi."""
    vector: Floats = Rotation.from_matrix(attitude).as_rotvec()
    return vector


def angle_between(a: Floats, b: Floats) -> float:
    """Angle in rad between two vectors (3,)."""
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
