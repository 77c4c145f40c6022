"""What optical orientation says of a gyro: its matrix and its bias."""

from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from estimator.geometry import rotation
from estimator.orientation.attitude import G
from tests.bench.broad import Trial
from tests.bench.trackers import Floats

_INTERVAL_S = 1.0
_ROUNDS = 4
#: intervals whose residual is this many times the median are not believed: markers seen wrongly
_OUTLIER = 5.0
#: how the optical orientation is weighed: every so often, rad; the gyro's noise, rad/s per root Hz, and share of the way
_OPTICAL_S, _OPTICAL_STD = 0.25, np.radians(0.3)
_GYRO_NOISE, _WAY_SHARE = np.radians(0.01), 3e-4


def matrix_of(trials: list[Trial]) -> Floats:
    """M (3, 3) of rate = M (reading - bias), by least squares on the rotations over about a second of all trials.

    The bias is that of the rests. Gauss-Newton on the rotation vector between the optical rotation and the integrated one.
    """
    steps, seen = (np.concatenate(both) for both in zip(*(_intervals(trial) for trial in trials), strict=True))
    matrix = np.eye(3)
    for _ in range(_ROUNDS):
        carried = rotation.chained(steps @ matrix.T)
        missed = rotation.log(np.swapaxes(carried[:, -1], -1, -2) @ seen)
        # A step changed by d changes the end by (attitude after it to the end)⁻¹ d, and d = (change of M) (step).
        turn = np.swapaxes(carried[:, -1], -1, -2)[:, None] @ carried[:, 1:]
        jacobian = np.einsum("ikab,ikc->iabc", turn, steps).reshape(len(steps), 3, 9)
        size = np.linalg.norm(missed, axis=1)
        kept = size < _OUTLIER * np.median(size)
        change, *_ = np.linalg.lstsq(jacobian[kept].reshape(-1, 9), missed[kept].ravel(), rcond=None)
        matrix = matrix + change.reshape(3, 3)
    return matrix


def _intervals(trial: Trial) -> tuple[Floats, Floats]:
    """Steps (m, n, 3) rad of the gyro, bias removed, over each interval with movement in it, and what was seen (m, 3, 3)."""
    n = round(_INTERVAL_S * trial.rate_hz)
    seen = ~np.isnan(trial.attitude[:, 0])
    begins = [
        a for a, b in pairwise(range(0, len(trial.gyro), n)) if trial.moving[a : b + 1].any() and seen[a] and seen[b]
    ]
    at = np.array(begins)[:, None] + np.arange(1, n + 1)
    steps = (trial.gyro - trial.bias)[at] / trial.rate_hz
    first, last = (_rotation(trial.attitude[end]) for end in (at[:, 0] - 1, at[:, -1]))
    return steps, np.asarray((first.inv() * last).as_matrix())


def bias_by_optics(trial: Trial, matrix: Floats, walk: float, start_std: float) -> Floats:
    """(n, 3) the bias that the optical orientation itself shows in real time, through a matrix (3, 3).

    What no method with an accelerometer can hope for: it sees the heading too, and no linear acceleration disturbs it. A Kalman
    filter of attitude error (earth) and bias, four times a second; walk rad/s per root s, start_std rad/s.
    """
    n = max(1, round(_OPTICAL_S * trial.rate_hz))
    seen = ~np.isnan(trial.attitude[:, 0])
    first = int(np.argmax(seen))
    attitude, bias = _rotation(trial.attitude[first : first + 1])[0], np.zeros(3)
    P = np.diag([_OPTICAL_STD**2] * 3 + [start_std**2] * 3)
    found = np.zeros_like(trial.gyro)
    for begin in range(first, len(found) - n, n):
        found[begin : begin + n] = bias
        rate = (trial.gyro[begin + 1 : begin + n + 1] - bias) @ matrix.T
        path = rotation.attitudes(rate, np.full(n, 1 / trial.rate_hz))
        F = np.eye(6)
        F[:3, 3:] = -attitude.as_matrix() @ (path[:-1] + path[1:]).sum(axis=0) / 2 @ matrix / trial.rate_hz
        attitude = attitude * Rotation.from_matrix(path[-1])
        way = float(np.linalg.norm(rate, axis=1).sum()) / trial.rate_hz
        noise = _GYRO_NOISE**2 * n / trial.rate_hz + (_WAY_SHARE * way) ** 2
        P = F @ P @ F.T + np.diag([noise] * 3 + [walk**2 * n / trial.rate_hz] * 3)
        if seen[begin + n]:
            missed = (_rotation(trial.attitude[begin + n : begin + n + 1])[0] * attitude.inv()).as_rotvec()
            R = _OPTICAL_STD**2 * np.eye(3)
            # A marker seen wrongly counts less.
            unlikely = float(missed @ np.linalg.solve(P[:3, :3] + R, missed)) / 12
            S = P[:3, :3] + R * max(1.0, unlikely)
            gain = np.linalg.solve(S, P[:3]).T
            change, P = gain @ missed, P - gain @ P[:3]
            attitude, bias = Rotation.from_rotvec(change[:3]) * attitude, bias + change[3:]
    found[begin + n :] = bias
    return found


def level_force(trial: Trial) -> Floats:
    """(n, 3) m/s² that a perfect accelerometer would read of the same turns if nothing pushed: gravity, as optics has it.

    A sample stands for the interval that ends at it.
    """
    seen = np.flatnonzero(~np.isnan(trial.attitude[:, 0]))
    middle = np.clip(np.arange(len(trial.attitude)) - 0.5, seen[0], seen[-1])
    attitude = Slerp(seen, _rotation(trial.attitude[seen]))(middle)
    return np.asarray(attitude.inv().apply([0.0, 0.0, G]))


def _rotation(wxyz: Floats) -> Rotation:
    return Rotation.from_quat(np.roll(wxyz, -1, axis=1))
