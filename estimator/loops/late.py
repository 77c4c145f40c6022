"""The loops behind track/since.py: the walk w from a measurement to now.

Rows (n + 5, 3) of one: E[e wᵀ] (n, 3) with the error e of the state, E[w wᵀ] (3, 3); in the first place of the next row how
many kelvin warmer it is now; and by how much more than E[w wᵀ] it has in common, along each axis, with a walk that began earlier.
"""

import numpy as np
from numpy.typing import NDArray

from estimator.loops.compiled import compiled

Floats = NDArray[np.float64]


@compiled("f8[:, ::1](i8, f8[:, :])")
def begun(n: int, walked: Floats) -> Floats:
    """Rows of what was measured while the bias, the first of n states, walked by a variance walked (3, 3), diagonal."""
    rows = np.zeros((n + 5, 3))
    for i in range(3):
        rows[i, i] = walked[i, i] / 2
        rows[n + i, i] = walked[i, i] / 3
        rows[n + 4, i] = walked[i, i] / 6
    return rows


@compiled("void(f8[:, :], f8[:, :], f8[:, :])")
def went_on(late: Floats, F: Floats, Q: Floats) -> None:
    """The state went on by F, with Q (n, n) added; the bias is the first of it."""
    n = len(F)
    after = np.zeros((n, 3))
    for i in range(n):
        for k in range(n):
            if F[i, k] != 0.0:
                for j in range(3):
                    after[i, j] += F[i, k] * late[k, j]
    late[:n] = after
    for i in range(3):
        for j in range(3):
            late[i, j] += Q[i, j]
            late[n + i, j] += Q[i, j]
    late[n + 3, 0] += F[0, 3]


@compiled("void(f8[:, :], f8[:, :], f8[:, :], f8[:, :])")
def knew_more(late: Floats, K: Floats, H: Floats, other: Floats) -> None:
    """The state took something in with gain K (n, m) by H (m, n): of now, with no other, or late itself, with rows of its own."""
    n, m = K.shape
    seen = np.zeros((m, 3))
    for i in range(m):
        for k in range(n):
            for j in range(3):
                seen[i, j] += H[i, k] * late[k, j]
        if len(other) > 0:
            # Of two walks to now the shorter is a part of the longer, and its first step, of which it has a mean, all of it is.
            shorter = late if late[n, 0] < other[n, 0] else other
            for j in range(3):
                seen[i, j] -= H[i, j] * shorter[n + 4, j]
                for k in range(3):
                    seen[i, j] -= H[i, k] * shorter[n + k, j]
    for k in range(n):
        for i in range(m):
            for j in range(3):
                late[k, j] -= K[k, i] * seen[i, j]


@compiled("f8[:, ::1](f8[:, :], f8[:, :])")
def sight(late: Floats, H: Floats) -> Floats:
    """(m, 2 n + m): what a measurement of then by H (m, n) sees of the state as it is now.

    Beside that the covariance of its noise with the error of the state, and what the walk adds to that noise.
    """
    m, n = H.shape
    rows = np.zeros((m, 2 * n + m))
    warmer = late[n + 3, 0]
    for i in range(m):
        rows[i, :n] = H[i]
        for k in range(3):
            rows[i, 3 + k] -= warmer * H[i, k]
            for j in range(n):
                rows[i, n + j] -= late[j, k] * H[i, k]
            for j in range(m):
                for q in range(3):
                    rows[i, 2 * n + j] += H[i, k] * late[n + k, q] * H[j, q]
    return rows
