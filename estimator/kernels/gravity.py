"""Kernel of tracking/gravity.py: propagates the filter's state over a span."""

import numpy as np
from numpy.typing import NDArray

from estimator.kernels.compiled import compiled

Floats = NDArray[np.float64]


@compiled("Tuple((f8[::1], f8[:, ::1], f8[:, ::1]))(f8[:], f8[:, :], f8[:, ::1], f8, f8, UniTuple(f8, 3))")
def carried(
    x: Floats, P: Floats, span: Floats, kept: float, strength: float, noise: tuple[float, float, float]
) -> tuple[Floats, Floats, Floats]:
    """Propagate the state x (24,) of tracking/gravity.py over a span: new state (24,), F and Q (24, 24).

    P (24, 24): covariance of x. span: rows of kernels/strapdown.py. kept: share of the accelerometer's bias that
    remains. strength: magnitude of gravity, m/s². noise: variances that the span adds to the rotation, to each velocity
    component and to each accelerometer bias component.
    An uncertain angle, from bias or matrix, also shifts gravity by half of its square. F has no such term, so Q has it
    as noise (second order; A. H. Jazwinski, "Stochastic Processes and Filtering Theory" (1970), ch. 9).
    """
    turned, pushed, posed = noise
    bias, g, v, a, m = 0, 6, 9, 12, 15  # index of each part of the state
    end, push, push_by_accel, seconds = span[:3], span[3], span[12:15], span[33, 0]
    moved, F, Q, after = np.empty(24), np.zeros((24, 24)), np.zeros((24, 24)), np.empty(3)
    for i in range(24):
        moved[i], F[i, i] = x[i], 1.0
    for i in range(3):
        after[i] = x[v + i] + push[i] - x[g + i] * seconds
    # Cross-product matrices of g and after.
    tilts, swings, tilting = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    tilts[2, 1], tilts[0, 2], tilts[1, 0] = x[g], x[g + 1], x[g + 2]
    tilts[1, 2], tilts[2, 0], tilts[0, 1] = -x[g], -x[g + 1], -x[g + 2]
    swings[2, 1], swings[0, 2], swings[1, 0] = after[0], after[1], after[2]
    swings[1, 2], swings[2, 0], swings[0, 1] = -after[0], -after[1], -after[2]
    tilt, swing, doubt = np.empty(9), np.empty(9), 0.0
    for part, n, at in ((bias, 3, 6), (m, 9, 15)):
        turn, pushing = span[at : at + n].reshape(3, n), span[at + n : at + 2 * n].reshape(3, n)
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
                    F[g + i, part + j] += end[k, i] * tilt[k]
                    F[v + i, part + j] += end[k, i] * swing[k]
    norm = 0.0
    for i in range(3):
        moved[g + i] = moved[v + i] = 0.0
        moved[a + i] = kept * x[a + i]
        F[a + i, a + i] = kept
        for k in range(3):
            moved[g + i] += end[k, i] * x[g + k]
            moved[v + i] += end[k, i] * after[k]
            F[g + i, g + k] = F[v + i, v + k] = end[k, i]
            F[v + i, g + k] = -seconds * end[k, i]
            for j in range(3):
                tilting[i, j] += end[k, i] * tilts[k, j]
                F[v + i, a + j] += end[k, i] * push_by_accel[k, j]
        norm += moved[g + i] ** 2
    for i in range(3):
        moved[g + i] *= strength / np.sqrt(norm)
        # A rotation tilts g by its whole angle and v by half of that on average.
        for j in range(3):
            tilted = 0.0
            for k in range(3):
                tilted += turned * tilting[i, k] * tilting[j, k]
            if i == j:
                tilted += (strength * doubt / 2) ** 2
            Q[g + i, g + j] = tilted
            Q[g + i, v + j] = Q[v + i, g + j] = -seconds / 2 * tilted
            Q[v + i, v + j] = seconds**2 / 4 * tilted
        Q[v + i, v + i] += pushed
        Q[a + i, a + i] = posed
    return moved, F, Q
