"""The arithmetic of tracking alone, of many devices side by side in arrays: what no bookkeeping in Python gets below.

Windows' and seconds' spreads, the way turned, the push and how both depend on bias and matrix (strapdown.py), the transition of
24 states: nothing is judged, no evidence is weighed, nothing is kept. The filter's own steps come on top: filterpy has no
arrays of filters.
"""

from time import process_time

import numpy as np
from numpy.typing import NDArray

from estimator import rotation

Floats = NDArray[np.float64]
STATES, WINDOWS = 24, 8


def arithmetic(gyro: Floats, accel: Floats, rate_hz: float) -> float:
    """CPU seconds of some seconds of many devices, each with so many samples: gyro and accel (seconds, devices, n, 3)."""
    _second(gyro[0], accel[0], rate_hz)
    begun = process_time()
    for second in zip(gyro, accel, strict=True):
        _second(*second, rate_hz)
    return process_time() - begun


def _second(gyro: Floats, accel: Floats, rate_hz: float) -> Floats:
    devices, n, _ = gyro.shape
    dt = np.full((devices, n), 1 / rate_hz)
    read = np.concatenate([gyro, accel], axis=-1)
    _spread(read.reshape(devices, WINDOWS, -1, 6)), _spread(read)
    rate = gyro @ np.tile(np.eye(3), (devices, 1, 1))
    attitude = rotation.attitudes(rate, dt)
    mid = 0.5 * (attitude[:, :-1] + attitude[:, 1:])
    carried = mid * dt[..., None, None]
    force = np.matmul(mid, accel[..., None])[..., 0]
    pushes = force * dt[..., None]
    ahead = np.add.accumulate(pushes[:, ::-1], axis=1)[:, ::-1]
    moved = np.cross(ahead[..., None], carried, axisa=-2, axisb=-2, axisc=-2)
    by_bias, push_by_bias = carried.sum(axis=1), moved.sum(axis=1)
    by_matrix, push_by_matrix = (
        np.matmul(of.reshape(devices, n, 9).swapaxes(1, 2), rate).reshape(devices, 3, 9) for of in (carried, moved)
    )
    C = attitude[:, -1].swapaxes(1, 2)
    F = np.tile(np.eye(STATES), (devices, 1, 1))
    F[:, 6:9, 6:9] = F[:, 9:12, 9:12] = C
    F[:, 6:9, :3], F[:, 6:9, 15:], F[:, 9:12, :3], F[:, 9:12, 15:] = by_bias, by_matrix, push_by_bias, push_by_matrix
    return F


def _spread(read: Floats) -> tuple[Floats, Floats]:
    mean = read.mean(axis=-2)
    off = read - mean[..., None, :]
    return mean, np.sqrt((off * off).sum(axis=-2) / (read.shape[-2] - 1))
