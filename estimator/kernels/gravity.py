"""Kernel of tracking/gravity.py: propagates the filter's state over a span, an uninterrupted stretch of about a second.

State (24): gyro bias (3) rad/s, its slope by temperature (3) rad/s/K, gravity (3) m/s², velocity (3) m/s, accelerometer
bias (3) m/s², relative change of the gyro matrix (9). Vectors are in sensor axes.
"""

import numpy as np

from estimator.kernels.compiled import Floats, compiled

#: index of gravity, velocity, accelerometer bias and the gyro's matrix in the state; the gyro's bias is first
_G, _V, _A, _M = 6, 9, 12, 15


def crossing(v: Floats) -> Floats:
    """Cross-product matrix (3, 3) of a vector v (3,), in the unit of v."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def steered(F: Floats, P: Floats, span: Floats, at: tuple[int, int, int], tilts: Floats, swings: Floats) -> float:
    """Add to F the derivatives of gravity and velocity after a span by n gyro parameters (bias or matrix change).

    F, P (24, 24): transition matrix, changed in place, and covariance of the state. span (34, 3): rows of kernels/strapdown.py.
    at: index of the first parameter in the state, n, and row of the parameters' derivatives in `span`.
    tilts, swings (3, 3): cross-product matrices of gravity (m/s²) and of velocity (m/s).
    Returns the variance of the angle of rotation over the span from the parameters' covariance, rad².
    """
    part, n, row = at
    turn, pushing = span[row : row + n].reshape(3, n), span[row + n : row + 2 * n].reshape(3, n)
    tilt, swing, doubt = np.empty(3), np.empty(3), 0.0
    for j in range(n):
        for i in range(3):
            for k in range(n):
                doubt += turn[i, j] * P[part + j, part + k] * turn[i, k]
        for i in range(3):
            tilt[i], swing[i] = 0.0, pushing[i, j]
            for k in range(3):
                tilt[i] += tilts[i, k] * turn[k, j]
                swing[i] += swings[i, k] * turn[k, j]
        for i in range(3):
            for k in range(3):
                F[_G + i, part + j] += span[k, i] * tilt[k]
                F[_V + i, part + j] += span[k, i] * swing[k]
    return doubt


def carried_over(x: Floats, span: Floats, after: Floats, kept: float, strength: float) -> Floats:
    """State x (24,) after a span: gravity (m/s²) and velocity (m/s) in sensor axes at the end of the span.

    x (24,): state before the span. span (34, 3): rows of kernels/strapdown.py, which begin with the rotation over the span.
    after (3,): velocity after the span in axes of its start, m/s.
    kept: factor on the accelerometer bias, 0 to 1.
    strength: magnitude to which gravity is scaled, m/s².
    """
    moved, norm = x.copy(), 0.0
    for i in range(3):
        moved[_G + i] = moved[_V + i] = 0.0
        moved[_A + i] = kept * x[_A + i]
        for k in range(3):
            moved[_G + i] += span[k, i] * x[_G + k]
            moved[_V + i] += span[k, i] * after[k]
        norm += moved[_G + i] ** 2
    for i in range(3):
        moved[_G + i] *= strength / np.sqrt(norm)
    return moved


def stirred(Q: Floats, tilting: Floats, seconds: float, doubt: float, noise: tuple[float, float, float]) -> None:
    """Write the process noise of gravity, velocity and accelerometer bias over a span into Q (24, 24).

    tilting (3, 3): derivative of gravity by a small rotation, m/s² per rad.
    seconds: length of the span, s.
    doubt: variance of each component of gravity from second-order effects of an uncertain angle, (m/s²)².
    noise (3,): variances of rotation (rad²), velocity ((m/s)²) and accelerometer bias ((m/s²)²) from the span.
    """
    turned, pushed, posed = noise
    for i in range(3):
        # A rotation tilts g by its whole angle and v by half of that on average.
        for j in range(3):
            tilted = 0.0
            for k in range(3):
                tilted += turned * tilting[i, k] * tilting[j, k]
            if i == j:
                tilted += doubt
            Q[_G + i, _G + j] = tilted
            Q[_G + i, _V + j] = Q[_V + i, _G + j] = -seconds / 2 * tilted
            Q[_V + i, _V + j] = seconds**2 / 4 * tilted
        Q[_V + i, _V + i] += pushed
        Q[_A + i, _A + i] = posed


@compiled(
    "Tuple((f8[::1], f8[:, ::1], f8[:, ::1]))(f8[:], f8[:, :], f8[:, ::1], f8, f8, UniTuple(f8, 3))",
    *(crossing, steered, carried_over, stirred),
)
def carried(
    x: Floats, P: Floats, span: Floats, kept: float, strength: float, noise: tuple[float, float, float]
) -> tuple[Floats, Floats, Floats]:
    """Propagate the state x (24,) of tracking/gravity.py over a span; return the new state (24,), F and Q (24, 24).

    F: transition matrix. Q: process noise.
    P (24, 24): covariance of x. span (34, 3): rows of kernels/strapdown.py.
    kept: factor on the accelerometer bias, 0 to 1. strength: magnitude of gravity, m/s².
    noise (3,): variances that the span adds to the rotation (rad²), to each velocity component ((m/s)²), and to each
        accelerometer bias component ((m/s²)²).
    An uncertain angle, from bias or matrix, also shifts gravity by half of its square. F has no such term, so Q has it
    as noise (second order; A. H. Jazwinski, "Stochastic Processes and Filtering Theory" (1970), ch. 9).
    """
    F, Q, after, tilting = np.eye(24), np.zeros((24, 24)), np.empty(3), np.zeros((3, 3))
    push, push_by_accel, seconds = span[3], span[12:15], span[33, 0]
    for i in range(3):
        after[i] = x[_V + i] + push[i] - x[_G + i] * seconds
    tilts = crossing(x[_G : _G + 3])
    doubt = steered(F, P, span, (0, 3, 6), tilts, crossing(after)) + steered(
        F, P, span, (_M, 9, 15), tilts, crossing(after)
    )
    for i in range(3):
        F[_A + i, _A + i] = kept
        for k in range(3):
            F[_G + i, _G + k] = F[_V + i, _V + k] = span[k, i]
            F[_V + i, _G + k] = -seconds * span[k, i]
            for j in range(3):
                tilting[i, j] += span[k, i] * tilts[k, j]
                F[_V + i, _A + j] += span[k, i] * push_by_accel[k, j]
    stirred(Q, tilting, seconds, (strength * doubt / 2) ** 2, noise)
    return carried_over(x, span, after, kept, strength), F, Q
