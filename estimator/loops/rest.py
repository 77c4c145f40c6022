"""The loops behind track/zaru.py: whether some seconds may be one rest, and what a rest measures."""

import numpy as np
from numpy.typing import NDArray

from estimator.loops.compiled import compiled

Floats = NDArray[np.float64]

#: means of a rest that gravity is looked for in: none is held for as many seconds
_HELD = 32


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


def nothing_held() -> Floats:
    """The state (1 + _HELD, 5) of `tilted` ahead of the first mean."""
    return np.zeros((1 + _HELD, 5))


@compiled("i8(f8[:, ::1], f8, f8[:], f8[:], i8, UniTuple(f8, 4))")
def tilted(state: Floats, now: float, mean: Floats, std: Floats, samples: int, knobs: tuple[float, ...]) -> int:
    """1 if gravity has turned since the first mean that is held, -1 if that is long ago and it has not, 0 if nobody knows.

    mean, std (3,) of an accelerometer's samples about now, s. state: in its first row how many means are held, then of each the
    time, itself, and its variance along an axis; begun anew when it turns. knobs: s for which one is held, for how many standard
    deviations it has turned, what variance there always is, and s that are long.
    """
    over_s, sigmas, floor_var, settled_s = knobs
    held, square, spread, dot, crossed = int(state[0, 0]), 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        square += mean[k] ** 2
        spread += std[k] ** 2
    var, gone, found = spread / (3 * samples) + floor_var, 0, 0
    while gone < held and (now - state[1 + gone, 0] > over_s or held - gone == _HELD):
        gone += 1
    for i in range(gone, held):
        state[1 + i - gone] = state[1 + i]
    held -= gone
    if held:
        first = state[1, 1:4]
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            dot += first[k] * mean[k]
            crossed += (first[i] * mean[j] - first[j] * mean[i]) ** 2
        if np.arctan2(np.sqrt(crossed), dot) > sigmas * np.sqrt((var + state[1, 4]) / square):
            held, found = 0, 1
        elif now - state[1, 0] >= settled_s:
            found = -1
    latest = state[1 + held]
    latest[0], latest[1:4], latest[4], state[0, 0] = now, mean, var, held + 1
    return found


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
