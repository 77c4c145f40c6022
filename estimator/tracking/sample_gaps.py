"""Uncertainty of a second with lost samples.

The first reading after a hole is held for all of it, where the lost ones would have gone their own way: the two readings around
it differ by so much, and one reading from the next, elsewhere in the second, by so much for each that is missing.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: longer than so many of the usual steps from sample to sample, a step is a hole
HOLE = 1.5
#: s from reading to reading; no gyro is faster, and a clock that counts too coarsely shows none
_LEAST = 5e-5


def unseen(dt: Floats, reading: Floats, before: Floats) -> float:
    """By how much the integral of readings (n, k), each held for dt (n,) s, may be off for what was lost, rms.

    before (k,): the reading before the first. No hole is longer than a gap, in which nothing is known of the way.
    """
    if float(dt.max()) * len(dt) <= HOLE * float(dt.sum()):
        return 0.0
    usual = max(float(np.median(dt)), _LEAST)
    holes = dt > HOLE * usual
    lost_s = dt[holes] - usual
    steps = np.square(np.diff(reading, axis=0, prepend=before[None])).sum(axis=1)
    wander = (lost_s / usual) ** 2 * (steps[~holes].mean() if not holes.all() else 0.0)
    return float(np.sqrt(np.sum(lost_s**2 * (steps[holes] + wander) / 4)))
