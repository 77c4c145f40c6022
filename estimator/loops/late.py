"""The loops behind track/walk.py: k walks (k, n, 3), and what a measurement at the first of them sees of now."""

import numpy as np
from numpy.typing import NDArray

from estimator.loops.compiled import compiled

Floats = NDArray[np.float64]


@compiled("void(f8[:, :, ::1], f8[:, :], f8[:])")
def stepped(cross: Floats, F: Floats, walked: Floats) -> None:
    """The state went on by F (n, n), its bias, the first three of it, with a walk of variance (3,)."""
    n = len(F)
    before = np.empty((n, 3))
    for at in range(len(cross)):
        before[:] = cross[at]
        cross[at] = 0.0
        for i in range(n):
            for k in range(n):
                if F[i, k] != 0.0:
                    for j in range(3):
                        cross[at, i, j] += F[i, k] * before[k, j]
        for j in range(3):
            cross[at, j, j] += walked[j]


@compiled("void(f8[:, :, ::1], f8[:, :], f8[:, :], f8[:, :])")
def taken(cross: Floats, K: Floats, H: Floats, common: Floats) -> None:
    """The state took a measurement in with gain K (n, m) by H (m, n), whose noise has variances common (k, 3) with the walks."""
    n, m = K.shape
    seen = np.empty(3)
    # One part of the measurement after the other would see what the one before did.
    before = np.empty((n, 3))
    for at in range(len(cross)):
        before[:] = cross[at]
        for i in range(m):
            for j in range(3):
                seen[j] = -H[i, j] * common[at, j]
            for k in range(n):
                if H[i, k] != 0.0:
                    for j in range(3):
                        seen[j] += H[i, k] * before[k, j]
            for k in range(n):
                for j in range(3):
                    cross[at, k, j] -= K[k, i] * seen[j]


@compiled("Tuple((f8[:, ::1], f8[:, ::1], f8[:, ::1]))(f8[:, :], f8[:, ::1], f8[:])")
def sight(H: Floats, cross: Floats, own: Floats) -> tuple[Floats, Floats, Floats]:
    """Of a measurement by H (m, n) at a walk, cross (n, 3) and own (7,): see Walks.sight."""
    m, n = H.shape
    now, noise, M = H.copy(), np.zeros((m, m)), np.zeros((n, m))
    for i in range(m):
        for k in range(3):
            now[i, 3 + k] -= own[6] * H[i, k]
            for j in range(m):
                noise[i, j] += H[i, k] * own[k] * H[j, k]
            for j in range(n):
                M[j, i] -= cross[j, k] * H[i, k]
    return now, noise, M
