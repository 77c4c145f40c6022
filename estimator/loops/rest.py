"""The loops behind track/zaru.py: whether some seconds may be one rest, and what a rest measures."""

import numpy as np
from numpy.typing import NDArray

from estimator.loops.compiled import compiled

Floats = NDArray[np.float64]


@compiled("b1(f8[:, :, ::1], i8, f8[:], f8[:], f8, f8)")
def calm(means: Floats, before: int, mean: Floats, var: Floats, motion_var: float, scatter: float) -> bool:
    """Whether a mean (3,) with variance (3,) and those before it scatter, along each axis, less than so many times what they may.

    means (n, 2, 3): the latest n of them and their variances, where this one is put, too. motion_var: of a resting body, which no
    variance tells of. Two are always calm.
    """
    n = min(before + 1, len(means))
    means[before % len(means), 0], means[before % len(means), 1] = mean, var
    for axis in range(3):
        middle = noise = spread = 0.0
        for i in range(n):
            middle += means[i, 0, axis] / n
            noise += means[i, 1, axis] / n
        for i in range(n):
            spread += (means[i, 0, axis] - middle) ** 2 / (n - 1)
        if n > 2 and not spread < scatter * (noise + motion_var):
            return False
    return True


@compiled("f8[:, ::1](f8[:])")
def upright(up: Floats) -> Floats:
    """(3, 3) unit vectors: two across up (3,), and along it."""
    rows, least, length = np.zeros((3, 3)), 0, 0.0
    for i in range(3):
        length += up[i] ** 2
        least = i if abs(up[i]) < abs(up[least]) else least
    for i in range(3):
        rows[2, i] = up[i] / np.sqrt(length)
    # Crossed with the axis that it is farthest from.
    one, other = (least + 1) % 3, (least + 2) % 3
    a, b = rows[2, one], rows[2, other]
    rows[0, one], rows[0, other] = b / np.sqrt(a * a + b * b), -a / np.sqrt(a * a + b * b)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rows[1, i] = rows[2, j] * rows[0, k] - rows[2, k] * rows[0, j]
    return rows


@compiled("f8[:, ::1](f8[:, :], f8[:], f8[:], f8[:], i8)")
def measured(along: Floats, mean: Floats, var: Floats, common: Floats, n: int) -> Floats:
    """(3, n + 5): H of a mean (3,) along three axes (3, 3), its covariance, itself, and what all share of its variance (3,)."""
    rows = np.zeros((3, n + 5))
    for i in range(3):
        for k in range(3):
            rows[i, k] = along[i, k]
            rows[i, n + 3] += along[i, k] * mean[k]
            rows[i, n + 4] += along[i, k] ** 2 * common[k]
            for j in range(3):
                rows[i, n + j] += along[i, k] * var[k] * along[j, k]
    return rows


@compiled("f8[:, ::1](f8[:, :], f8[:, :, :], f8[:])")
def together(z: Floats, R: Floats, common: Floats) -> Floats:
    """(m, m + 1): covariance and mean of k measurements z (k, m) with covariances (k, m, m), of which common (m,) is all theirs.

    Each counts by what it is worth: in a plain mean the first seconds, which are no proof, hid a turn from those that are.
    """
    k, m = z.shape
    rows, worth, total, square = np.zeros((m, m + 1)), np.empty(k), 0.0, 0.0
    for i in range(k):
        most = 0.0
        for j in range(m):
            most = max(most, R[i, j, j])
        worth[i] = 1 / most
        total += worth[i]
    for i in range(k):
        worth[i] /= total
        square += worth[i] ** 2
        for j in range(m):
            rows[j, m] += worth[i] * z[i, j]
            for q in range(m):
                rows[j, q] += worth[i] ** 2 * R[i, j, q]
    for j in range(m):
        rows[j, j] += (1 - square) * common[j]
    return rows
