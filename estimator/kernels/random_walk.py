"""Kernels of tracking/random_walk.py: propagate k bias walks (k, n, 3), and relate a late measurement to the present state."""

import numpy as np
from numpy.typing import NDArray

from estimator.kernels.compiled import compiled

Floats = NDArray[np.float64]


@compiled("Tuple((f8[:, :, ::1], f8[:, ::1]))(f8[:, :, ::1], f8[:, ::1], f8[:])")
def begun(cross: Floats, own: Floats, walked: Floats) -> tuple[Floats, Floats]:
    """Walks cross (k, n, 3) and own (k, 7) with a new walk appended: see RandomWalks.begin."""
    k, n, _ = cross.shape
    crosses, owns = np.zeros((k + 1, n, 3)), np.zeros((k + 1, 7))
    crosses[:k], owns[:k] = cross, own
    for i in range(3):
        crosses[k, i, i], owns[k, i], owns[k, 3 + i] = walked[i] / 2, walked[i] / 3, walked[i] / 6
    return crosses, owns


@compiled("void(f8[:, :, ::1], f8[:, ::1], f8[:, :], f8[:])")
def stepped(cross: Floats, own: Floats, F: Floats, walked: Floats) -> None:
    """Propagate all walks in place by a state step F (n, n); its bias, the first three states, walks with variance (3,)."""
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
            own[at, j] += walked[j]
        own[at, 6] += F[0, 3]


@compiled("void(f8[:, :, ::1], f8[:, ::1], f8[:, :], f8[:, :], f8)")
def taken(cross: Floats, own: Floats, K: Floats, H: Floats, part: float) -> None:
    """Update all walks in place for a measurement that the state took in with gain K (n, m) by H (m, n).

    part: 1 for a measurement at a walk that began earlier and contains these walks with all of their first step; 0 for
    a measurement of the present state.
    """
    n, m = K.shape
    before, seen = np.empty((n, 3)), np.empty(3)
    for at in range(len(cross)):
        before[:] = cross[at]  # every row of the measurement uses the values before the update
        for i in range(m):
            for j in range(3):
                seen[j] = -part * H[i, j] * (own[at, j] + own[at, 3 + j])
            for k in range(n):
                if H[i, k] != 0.0:
                    for j in range(3):
                        seen[j] += H[i, k] * before[k, j]
            for k in range(n):
                for j in range(3):
                    cross[at, k, j] -= K[k, i] * seen[j]


@compiled("Tuple((f8[:, ::1], f8[:, ::1], f8[:, ::1]))(f8[:, :], f8[:, ::1], f8[:])")
def sight(H: Floats, cross: Floats, own: Floats) -> tuple[Floats, Floats, Floats]:
    """Present slope H (m, n), added noise (m, m) and its covariance (n, m) with the state's error, for a measurement at a walk.

    H (m, n): slope of the measurement at its own time. cross (n, 3) and own (7,): the walk. See RandomWalks.sight.
    """
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
