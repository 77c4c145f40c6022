"""Integration error of a second with lost samples.

The integral holds the first reading after a hole over all of it. The lost readings would have differed from it by the
step between the readings around the hole, and by a usual step between neighbours for each lost sample.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: ratio of a time step to the usual one beyond which it is a hole
HOLE = 1.5
#: s, least usual time step: no gyro is faster, and a coarse clock may show zero
_LEAST = 5e-5


def unseen(dt: Floats, reading: Floats, before: Floats) -> float:
    """Rms error of the integral of readings (n, k), each held for dt (n,) s, caused by lost samples.

    before (k,): the reading before the first. Units: those of the readings times s. Holes longer than `seconds.GAP_S`
    make the second unusable instead.
    """
    usual = max(float(np.median(dt)), _LEAST)
    holes = dt > HOLE * usual
    lost_s = dt[holes] - usual
    steps = np.square(np.diff(reading, axis=0, prepend=before[None])).sum(axis=1)
    wander = (lost_s / usual) ** 2 * (steps[~holes].mean() if not holes.all() else 0.0)
    return float(np.sqrt(np.sum(lost_s**2 * (steps[holes] + wander) / 4)))
