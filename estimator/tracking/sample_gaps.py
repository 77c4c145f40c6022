"""Integration error of a one-second block with lost samples.

The integral holds the first reading after a gap over the whole gap. The error has two parts: half of the difference
between the readings on both sides of the gap, and an unknown change within the gap. The change within the gap is taken
as the rms difference between neighbouring readings, times half of the number of lost samples.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: ratio of a time step to the usual one beyond which it is a hole
HOLE = 1.5
#: s, least usual time step: no gyro is faster, and a coarse clock may show zero
_LEAST = 5e-5


def unseen(dt: Floats, reading: Floats, before: Floats) -> float:
    """Rms error of the integral of readings over a block with lost samples, in the readings' unit times s.

    dt (n,): time for which each reading is held, s.
    reading (n, k): gyro (rad/s) or accelerometer (m/s²) readings. before (k,): the reading before the first.
    Gaps longer than `seconds.GAP_S` (0.25 s) must be rejected before.
    """
    usual = max(float(np.median(dt)), _LEAST)
    holes = dt > HOLE * usual
    lost_s = dt[holes] - usual
    steps = np.square(np.diff(reading, axis=0, prepend=before[None])).sum(axis=1)
    wander = (lost_s / usual) ** 2 * (steps[~holes].mean() if not holes.all() else 0.0)
    return float(np.sqrt(np.sum(lost_s**2 * (steps[holes] + wander) / 4)))
