"""The loop behind BiasFilter.weigh: a measurement against what is believed."""

import numpy as np
from numpy.typing import NDArray

from estimator.loops.compiled import compiled

Floats = NDArray[np.float64]


@compiled("Tuple((f8[::1], f8[:, ::1], f8))(f8[:], f8[:, :], f8[:, :], f8[:], f8[:, :], f8[:, :], f8[:, :])")
def weighed(
    z: Floats, H: Floats, R: Floats, x: Floats, P: Floats, cross: Floats, walked: Floats
) -> tuple[Floats, Floats, float]:
    """Innovation (m,), its covariance (m, m) and NIS of a measurement z (m,) = H (m, n) x with covariance R (m, m).

    The NIS is not finite where not all of that is. Of a measurement of the bias (the first of x) that is taken late, cross
    (n, 3) and walked (3, 3) are those of since.py; else (0, 3).
    """
    m, n = H.shape
    innovation, S = z.copy(), np.empty((m, m))
    seen, noise = np.zeros((m, n)), np.zeros((m, n))  # H P, and H of what the error of x has in common with the walk
    for i in range(m):
        for k in range(n):
            if H[i, k] != 0.0:
                innovation[i] -= H[i, k] * x[k]
                for j in range(n):
                    seen[i, j] += H[i, k] * P[k, j]
    late = len(cross) > 0
    for i in range(m):
        for j in range(m):
            S[i, j] = R[i, j]
            for k in range(n):
                S[i, j] += seen[i, k] * H[j, k]
    if late:
        for i in range(m):
            for k in range(3):
                for j in range(n):
                    noise[i, k] += H[i, j] * cross[j, k]
        for i in range(m):
            for j in range(m):
                for k in range(3):
                    S[i, j] -= noise[i, k] * H[j, k] + H[i, k] * noise[j, k]
                    for q in range(3):
                        S[i, j] += H[i, k] * walked[k, q] * H[j, q]
    # Cholesky: L L' = S, L y = innovation, NIS = y' y.
    L, y, nis = np.zeros((m, m)), np.zeros(m), 0.0
    for i in range(m):
        y[i] = innovation[i]
        for j in range(i):
            L[i, j] = S[i, j]
            for k in range(j):
                L[i, j] -= L[i, k] * L[j, k]
            L[i, j] /= L[j, j]
            y[i] -= L[i, j] * y[j]
        square = S[i, i]
        for k in range(i):
            square -= L[i, k] ** 2
        L[i, i] = np.sqrt(square)
        y[i] /= L[i, i]
        nis += y[i] ** 2
    # What is infinite, or has a determinant that is, may make all else look well.
    determinant = 1.0
    for i in range(m):
        determinant *= L[i, i] ** 2
        for j in range(m):
            nis += 0.0 * (S[i, i] * S[j, j])
            nis += 0.0 * S[i, j]
    # What H does not see comes into the state with the gain all the same.
    for k in range(n):
        nis += 0.0 * x[k]
        for j in range(n):
            nis += 0.0 * P[k, j]
    return innovation, S, nis + 0.0 / determinant + 0.0 * determinant
