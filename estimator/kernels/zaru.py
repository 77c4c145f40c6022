"""Kernels of tracking/zaru.py: test that one-second blocks belong to one rest, and form their zero-rate measurement."""

import numpy as np

from estimator.kernels.compiled import Floats, compiled


@compiled("b1(f8[:, :, ::1], f8, f8)")
def calm(means: Floats, motion_var: float, scatter: float) -> bool:
    """Return True if the means of k one-second blocks scatter as little as in one rest.

    means (k, 2, 3): means (rad/s), and their variances ((rad/s)²).
    motion_var: variance of a resting body's motion, (rad/s)², added to these variances.
    scatter: limit for the ratio of observed to expected variance, on every axis. Two means always pass.
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
    """Orthonormal axes (3, 3) as rows, from the vertical up (3,) of any length: two horizontal axes, then the vertical."""
    axes, least, square = np.zeros((3, 3)), 0, 0.0
    for i in range(3):
        square += up[i] ** 2
        least = i if abs(up[i]) < abs(up[least]) else least
    for i in range(3):
        axes[2, i] = up[i] / np.sqrt(square)
    # Cross product with the coordinate axis farthest from it.
    i, j = (least + 1) % 3, (least + 2) % 3
    length = np.sqrt(axes[2, i] ** 2 + axes[2, j] ** 2)
    axes[0, i], axes[0, j] = -axes[2, j] / length, axes[2, i] / length
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        axes[1, k] = axes[2, i] * axes[0, j] - axes[2, j] * axes[0, i]
    return axes


@compiled("Tuple((f8[::1], f8[:, ::1], f8[:, ::1], f8[::1]))(f8[:, :], f8[:], f8[:], f8[:], i8)")
def along(axes: Floats, mean: Floats, var: Floats, common: Floats, n: int) -> tuple[Floats, Floats, Floats, Floats]:
    """Measurement of the bias along axes (m, 3) from a mean rate: z (m,), H (m, n), R (m, m), common variances (m,).

    z: mean rate along the axes, rad/s. H: its derivatives by the filter's state. R: its covariance, (rad/s)².
    axes (m, 3): unit vectors in sensor axes.
    mean (3,): rad/s. var (3,): its variance, (rad/s)². common (3,): part of var from the error that all means share,
        (rad/s)².
    n: number of states of the filter.
    """
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
    """Weighted mean (m,) and covariance (m, m) of k measurements z (k, m), with weights of inverse variance.

    R (k, m, m): covariances. common (m,): variance of the error that all measurements share. Units: rad/s and (rad/s)².
    The weights keep uncertain first measurements from hiding a turn that later measurements show.
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
