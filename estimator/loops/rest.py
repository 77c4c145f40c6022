"""The loop behind track/zaru.py: whether some seconds may be one rest."""

import numpy as np
from numpy.typing import NDArray

from estimator.loops.compiled import compiled

Floats = NDArray[np.float64]


@compiled("b1(f8[:, :, :], f8, f8)")
def calm(means: Floats, motion_var: float, scatter: float) -> bool:
    """Whether means (n, 0, 3) with variances (n, 1, 3) scatter, along each axis, less than so many times what they may.

    motion_var: of a resting body, which no variance tells of.
    """
    n = len(means)
    for axis in range(3):
        mean = noise = spread = 0.0
        for i in range(n):
            mean += means[i, 0, axis] / n
            noise += means[i, 1, axis] / n
        for i in range(n):
            spread += (means[i, 0, axis] - mean) ** 2 / (n - 1)
        if not spread < scatter * (noise + motion_var):
            return False
    return True
