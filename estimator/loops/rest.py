"""The loop behind track/zaru.py: whether some seconds may be one rest."""

import numpy as np
from numpy.typing import NDArray

from estimator.loops.compiled import compiled

Floats = NDArray[np.float64]


@compiled("b1(f8[:, :, ::1], f8, f8)")
def calm(means: Floats, motion_var: float, scatter: float) -> bool:
    """Whether means (k, 2, 3), with their variances, scatter less than so many times what they may; two are always calm.

    motion_var: of a resting body, which no variance tells of.
    """
    k = len(means)
    if k <= 2:
        return True
    for axis in range(3):
        middle = noise = spread = 0.0
        for i in range(k):
            middle += means[i, 0, axis] / k
            noise += means[i, 1, axis] / k
        for i in range(k):
            spread += (means[i, 0, axis] - middle) ** 2 / (k - 1)
        if not spread < scatter * (noise + motion_var):
            return False
    return True
