"""The loops behind tracking/zaru.py: whether some seconds may be one rest, and what they measure."""

import numpy as np
from numpy.typing import NDArray

from estimator.kernels.compiled import compiled

Floats = NDArray[np.float64]


@compiled("b1(f8[:, :, ::1], f8, f8)")
def calm(means: Floats, motion_var: float, scatter: float) -> bool:
    """Whether means (k, 2, 3), with their variances, scatter less than so many times what they may; two are always calm.

    motion_var: of a resting body, which no variance tells of.
    """
    k = len(means)
    if k <= 2:
        return True
    for axis in range(3):
        middle = noise = spread = 0.0
        for i in range(k):
            middle += means[i, 0, axis] / k
            noise += means[i, 1, axis] / k
        for i in range(k):
            spread += (means[i, 0, axis] - middle) ** 2 / (k - 1)
        if not spread < scatter * (noise + motion_var):
            return False
    return True


@compiled("f8[:, ::1](f8[:])")
def upright(up: Floats) -> Floats:
    """(3, 3) unit vectors: two across up (3,), and along it."""
    axes, least, square = np.zeros((3, 3)), 0, 0.0
    for i in range(3):
        square += up[i] ** 2
        least = i if abs(up[i]) < abs(up[least]) else least
    for i in range(3):
        axes[2, i] = up[i] / np.sqrt(square)
    # Crossed with the axis that it is farthest from.
    i, j = (least + 1) % 3, (least + 2) % 3
    length = np.sqrt(axes[2, i] ** 2 + axes[2, j] ** 2)
    axes[0, i], axes[0, j] = -axes[2, j] / length, axes[2, i] / length
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        axes[1, k] = axes[2, i] * axes[0, j] - axes[2, j] * axes[0, i]
    return axes


@compiled("Tuple((f8[::1], f8[:, ::1], f8[:, ::1], f8[::1]))(f8[:, :], f8[:], f8[:], f8[:], i8)")
def along(axes: Floats, mean: Floats, var: Floats, common: Floats, n: int) -> tuple[Floats, Floats, Floats, Floats]:
    """A mean (3,) of variance var (3,), of which common (3,) all means share, along axes (m, 3): z, H (m, n), R and common."""
    m = len(axes)
    z, H, R, shared = np.zeros(m), np.zeros((m, n)), np.zeros((m, m)), np.zeros(m)
    for i in range(m):
        for k in range(3):
            H[i, k] = axes[i, k]
            z[i] += axes[i, k] * mean[k]
            shared[i] += axes[i, k] ** 2 * common[k]
            for j in range(m):
                R[i, j] += axes[i, k] * var[k] * axes[j, k]
    return z, H, R, shared


@compiled("Tuple((f8[::1], f8[:, ::1]))(f8[:, ::1], f8[:, :, ::1], f8[:])")
def together(z: Floats, R: Floats, common: Floats) -> tuple[Floats, Floats]:
    """Mean (m,) and covariance of measurements z (k, m) with covariances R (k, m, m), of which they share variances common (m,).

    Each counts by what it is worth: in a plain mean the first seconds, which are no proof, hid a turn from those that are.
    """
    k, m = z.shape
    mean, cov, worth, square = np.zeros(m), np.zeros((m, m)), np.empty(k), 0.0
    for i in range(k):
        most = 0.0
        for j in range(m):
            most = max(most, R[i, j, j])
        worth[i] = 1 / most
    worth /= worth.sum()
    for i in range(k):
        square += worth[i] ** 2
        for j in range(m):
            mean[j] += worth[i] * z[i, j]
            for q in range(m):
                cov[j, q] += worth[i] ** 2 * R[i, j, q]
    for j in range(m):
        cov[j, j] += (1 - square) * common[j]
    return mean, cov
