"""The loops behind BiasFilter.weigh and its filter: a measurement against what is believed, and what an inverse is for."""

import numpy as np
from numpy.typing import NDArray

from estimator.loops.compiled import compiled

Floats = NDArray[np.float64]


@compiled("Tuple((f8[:, ::1], f8, f8))(f8[:], f8[:, :], f8[:, :], f8[:], f8[:, :], f8[:, :], i8)")
def weighed(
    z: Floats, H: Floats, R: Floats, x: Floats, P: Floats, late: Floats, first: int
) -> tuple[Floats, float, float]:
    """Of a measurement z (m,) = H (m, n) x with covariance R (m, m): its innovation, beside that its covariance, (m, 1 + m); NIS.

    The first so many of z are one that is taken before the others: what is said of those is what will be said then, and theirs
    is the other NIS. Neither is finite where not all of that is, or where R leaves a part of it without noise.
    late: the rows (n + 5, 3) of late.py where it is a measurement of then; else (0, 3).
    """
    m, n = H.shape
    rows, L = np.empty((m, 1 + m)), np.zeros((m, m))
    # H P, and what H sees of the error that x has in common with the walk.
    seen, noise = np.zeros((m, n)), np.zeros((m, 3))
    warmer = late[n + 3, 0] if len(late) > 0 else 0.0
    sight = H.copy()
    for i in range(m):
        for k in range(3):
            sight[i, 3 + k] -= warmer * H[i, k]
        rows[i, 0] = z[i]
        for k in range(n):
            if sight[i, k] != 0.0:
                rows[i, 0] -= sight[i, k] * x[k]
                for j in range(n):
                    seen[i, j] += sight[i, k] * P[k, j]
                if len(late) > 0:
                    for j in range(3):
                        noise[i, j] += sight[i, k] * late[k, j]
    # Cholesky: L L' = S, L y = innovation, NIS = y' y.
    y, before, nis = np.zeros(m), 0.0, 0.0
    for i in range(m):
        for j in range(m):
            S = R[i, j]
            for k in range(n):
                S += seen[i, k] * sight[j, k]
            if len(late) > 0:
                for k in range(3):
                    S -= noise[i, k] * H[j, k] + H[i, k] * noise[j, k]
                    for q in range(3):
                        S += H[i, k] * late[n + k, q] * H[j, q]
            rows[i, 1 + j] = S
    for i in range(m):
        y[i] = rows[i, 0]
        for j in range(i):
            L[i, j] = rows[i, 1 + j]
            for k in range(j):
                L[i, j] -= L[i, k] * L[j, k]
            L[i, j] /= L[j, j]
            y[i] -= L[i, j] * y[j]
        square = rows[i, 1 + i]
        for k in range(i):
            square -= L[i, k] ** 2
        L[i, i] = np.sqrt(square)
        y[i] /= L[i, i]
        if i < first:
            before += y[i] ** 2
        else:
            nis += y[i] ** 2
    # What is infinite, or has a determinant that is, may make all else look well.
    determinant, sound = 1.0, 0.0
    for i in range(m):
        determinant *= L[i, i] ** 2
        sound += 0.0 * rows[i, 0]
        for j in range(m):
            sound += 0.0 * (rows[i, 1 + i] * rows[j, 1 + j])
            sound += 0.0 * rows[i, 1 + j]
        if not R[i, i] > 0.0:
            sound = np.nan
    # What H does not see comes into the state with the gain all the same.
    for k in range(n):
        all_of_it = x[k]
        for j in range(n):
            all_of_it += 0.0 * P[k, j]
        sound += 0.0 * all_of_it
    sound += 0.0 / determinant + 0.0 * determinant
    # Of the others what the first leave unknown: the rest of the factor.
    for i in range(first, m if first else 0):
        rows[i, 0] = 0.0
        for k in range(first, i + 1):
            rows[i, 0] += L[i, k] * y[k]
        for j in range(m):
            rows[i, 1 + j] = 0.0
            for k in range(first, min(i, j) + 1):
                rows[i, 1 + j] += L[i, k] * L[j, k]
    return rows, nis + sound, before + sound


@compiled("f8[:, ::1](f8[:], f8[:, :], f8[:, :], f8[:], f8[:, :], f8[:, :])")
def stacked(z: Floats, H: Floats, R: Floats, then_z: Floats, then_H: Floats, then_R: Floats) -> Floats:
    """(m, n + m + 1): H, R and z of two measurements of m in all, whose noises have nothing to do with each other."""
    first, then, n = len(z), len(then_z), H.shape[1]
    m = first + then
    rows = np.zeros((m, n + m + 1))
    for i in range(first):
        rows[i, :n], rows[i, n + m] = H[i], z[i]
        for j in range(first):
            rows[i, n + j] = R[i, j]
    for i in range(then):
        rows[first + i, :n], rows[first + i, n + m] = then_H[i], then_z[i]
        for j in range(then):
            rows[first + i, n + first + j] = then_R[i, j]
    return rows


@compiled("f8[:, ::1](f8[:, :])")
def inverse(S: Floats) -> Floats:
    """Of a symmetric matrix: of one, two or three rows by its adjugate, of more by Gauss and Jordan."""
    found = np.empty((len(S), len(S)))
    if len(S) == 1:
        found[0, 0] = 1.0 / S[0, 0]
    elif len(S) == 2:
        a, b, d = S[0, 0], S[0, 1], S[1, 1]
        determinant = a * d - b * b
        found[0, 0], found[1, 1] = d / determinant, a / determinant
        found[0, 1] = found[1, 0] = -b / determinant
    elif len(S) == 3:
        a, b, c, d, e, f = S[0, 0], S[0, 1], S[0, 2], S[1, 1], S[1, 2], S[2, 2]
        x, y, z = d * f - e * e, c * e - b * f, b * e - c * d
        determinant = a * x + b * y + c * z
        found[0, 0], found[1, 1], found[2, 2] = (
            x / determinant,
            (a * f - c * c) / determinant,
            (a * d - b * b) / determinant,
        )
        found[0, 1] = found[1, 0] = y / determinant
        found[0, 2] = found[2, 0] = z / determinant
        found[1, 2] = found[2, 1] = (b * c - a * e) / determinant
    else:
        # What is positive definite needs no pivots.
        n = len(S)
        found[:] = S
        for k in range(n):
            pivot = 1.0 / found[k, k]
            found[k, k] = 1.0
            for j in range(n):
                found[k, j] *= pivot
            for i in range(n):
                if i != k:
                    factor, found[i, k] = found[i, k], 0.0
                    for j in range(n):
                        found[i, j] -= factor * found[k, j]
    return found
