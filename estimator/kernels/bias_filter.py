"""Kernels of tracking/bias_filter.py: innovation and NIS of a measurement, matrix inverse, and the step of the bias states.

Letters: x (n,) the state with covariance P (n, n); z (m,) a measurement with covariance R (m, m); H (m, n) the
derivatives of z by x. Units are those of tracking/bias_filter.py.
"""

import numpy as np

from estimator.kernels.compiled import Floats, compiled


def innovation(z: Floats, H: Floats, R: Floats, x: Floats, P: Floats, y: Floats, S: Floats) -> bool:
    """Write the innovation y = z - H x (m,) and its covariance S = H P H' + R (m, m), in the units of z.

    z (m,), H (m, n), R (m, m): measurement, its derivatives by the state, and its covariance.
    x (n,), P (n, n): state and its covariance. y, S: written.
    Returns True if y and S are finite and each element of z has a variance above 0.
    """
    (m, n), sound = H.shape, True
    seen = np.zeros((m, n))
    for i in range(m):
        y[i] = z[i]
        for k in range(n):
            if H[i, k] != 0.0:
                y[i] -= H[i, k] * x[k]
                for j in range(n):
                    seen[i, j] += H[i, k] * P[k, j]
        sound &= np.isfinite(y[i]) and R[i, i] > 0.0
    for i in range(m):
        for j in range(m):
            S[i, j] = R[i, j]
            for k in range(n):
                S[i, j] += seen[i, k] * H[j, k]
            sound &= np.isfinite(S[i, j])
    return sound


def whitened(y: Floats, S: Floats) -> tuple[Floats, Floats]:
    """Cholesky factor L (m, m) of S = L L', and the whitened innovation a (m,) with L a = y.

    y (m,): innovation. S (m, m): its covariance. The NIS of y is a' a.
    """
    m = len(y)
    L, a = np.zeros((m, m)), np.empty(m)
    for i in range(m):
        a[i] = y[i]
        for j in range(i + 1):
            L[i, j] = S[i, j]
            for k in range(j):
                L[i, j] -= L[i, k] * L[j, k]
            if j < i:
                L[i, j] /= L[j, j]
                a[i] -= L[i, j] * a[j]
        L[i, i] = np.sqrt(L[i, i])
        a[i] /= L[i, i]
    return L, a


def given(first: int, L: Floats, a: Floats, y: Floats, S: Floats) -> None:
    """Condition an innovation on its first elements: change y (m,) and S (m, m) in place to the conditional values.

    first: number of the elements that are given. The other elements of y become their innovations after an update with
        the first ones. The covariance S of the first with the other elements becomes 0.
    L (m, m), a (m,): result of `whitened`. Units stay those of z.
    """
    for i in range(first, len(y)):
        y[i] = 0.0
        for k in range(first, i + 1):
            y[i] += L[i, k] * a[k]
        S[i, :first], S[:first, i] = 0.0, 0.0
        for j in range(first, len(y)):
            S[i, j] = 0.0
            for k in range(first, min(i, j) + 1):
                S[i, j] += L[i, k] * L[j, k]


@compiled(
    "Tuple((f8[::1], f8[:, ::1], f8, f8))(f8[:], f8[:, :], f8[:, :], f8[:], f8[:, :], i8)",
    *(innovation, whitened, given),
)
def weighed(z: Floats, H: Floats, R: Floats, x: Floats, P: Floats, first: int) -> tuple[Floats, Floats, float, float]:
    """Innovation (m,) of z against H x, its covariance S (m, m), and the NIS of two groups of elements of z.

    z (m,), R (m, m), H (m, n): measurement, its covariance and its derivatives. x (n,), P (n, n): state and covariance.
    Results are in the units of z; the NIS has none.
    The groups are the first `first` elements of z, and the others. The values of the other elements are conditional on
    the first ones. S then has zeros between the two groups.
    The NIS is infinite where z, H or R is not finite, or where R leaves an element of z without noise.
    """
    m = len(z)
    y, S, before, nis = np.empty(m), np.empty((m, m)), 0.0, 0.0
    sound = innovation(z, H, R, x, P, y, S)
    L, a = whitened(y, S)
    for i in range(m):
        if i < first:
            before += a[i] * a[i]
        else:
            nis += a[i] * a[i]
    if first:
        given(first, L, a, y, S)
    sound &= np.isfinite(before + nis)
    return y, S, before if sound else np.inf, nis if sound else np.inf


@compiled("f8[:, ::1](f8[:, :])")
def inverse(S: Floats) -> Floats:
    """Inverse of a positive definite matrix S (m, m), by Gauss-Jordan elimination without pivoting."""
    m, found = len(S), S.copy()
    for k in range(m):
        pivot = 1.0 / found[k, k]
        found[k, k] = 1.0
        for j in range(m):
            found[k, j] *= pivot
        for i in range(m):
            if i != k:
                factor, found[i, k] = found[i, k], 0.0
                for j in range(m):
                    found[i, j] -= factor * found[k, j]
    return found


@compiled("void(f8[:], f8[:, :], f8[:, :], f8, f8, f8[:], f8)")
def walked(x: Floats, F: Floats, Q: Floats, warmer: float, over: float, bend: Floats, var: float) -> None:
    """Write a prediction step of bias (rad/s) and slope by temperature (rad/s/K) into x (n,), F and Q (n, n), in place.

    x: state. F: transition matrix. Q: process noise.
    warmer: temperature change, K; the bias changes by this times the slope.
    over: temperature change over which the slope may change, K. bend (3,): standard deviation of the slope's change,
        rad/s/K.
    var: variance of the random walk of the bias, (rad/s)².
    """
    for i in range(3):
        x[i] += warmer * x[3 + i]
        F[i, 3 + i] = warmer
        Q[i, i], Q[3 + i, 3 + i] = (over / 2 * bend[i]) ** 2 + var, bend[i] ** 2
