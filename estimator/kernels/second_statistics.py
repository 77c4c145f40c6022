"""Kernel of tracking/seconds.py: statistics of the readings of a second."""

import numpy as np
from numpy.typing import NDArray

from estimator.kernels.compiled import compiled

Floats = NDArray[np.float64]

#: most rounding steps that a grid may span, and largest distance from the grid, in steps: beyond, the step is finer
_LEVELS, _OFF_GRID = 512, 0.1
#: rows of the result of `measured`
MEAN, STD, STEP, MEAN_VAR, COMMON_VAR, JITTER, HELD, ACCEL_MEAN, ACCEL_STD, SCALARS = range(10)


@compiled("Tuple((f8[::1], f8[:, ::1], b1))(f8[:, ::1], f8, f8, f8, f8[:])")
def measured(
    samples: Floats, first: float, coarsest: float, step_if_none: float, known: Floats
) -> tuple[Floats, Floats, bool]:
    """Intervals dt (n,) of samples after time `first`, s; statistics in rows of three; and whether a sample is clipped.

    samples (n, 9): rows of samples/sample_buffer.py. Statistics of accel are NaN without an accelerometer.

    MEAN, STD: of the gyro. STEP: smallest difference between readings, to within a tenth of the least `known` (3,),
    which is updated; `step_if_none` if there is none. Where no STD is below `coarsest`, STEP is the least known.
    MEAN_VAR and COMMON_VAR: see gyro_model.py. JITTER: deviation from one reading to the next. HELD: 1 where all
    readings are equal. ACCEL_MEAN, ACCEL_STD: of accel. SCALARS: least STD, longest dt, mean magnitude of accel.
    """

    def on_grid(read: Floats, low: float, high: float, grid: float) -> float:
        """Smallest difference between readings on a grid; infinite where all are equal, NaN where they are off the grid."""
        # Sorting would take longer than all the rest here.
        if not high - low < _LEVELS * grid < np.inf:
            return np.nan
        taken = np.zeros(_LEVELS + 1, np.bool_)
        for i in range(len(read)):
            place = (read[i] - low) / grid
            level = int(place + 0.5)
            if abs(place - level) > _OFF_GRID:
                return np.nan
            taken[level] = True
        least, last = np.inf, 0
        for level in range(1, int((high - low) / grid + 0.5) + 1):
            if taken[level]:
                least, last = min(least, (level - last) * grid), level
        return least

    time, gyro, accel, clipped = samples[:, 0], samples[:, 1:4], samples[:, 4:7], samples[:, 7]
    n = len(time)
    dt, rows = np.empty(n), np.zeros((10, 3))
    before, longest, clips = first, -np.inf, False
    for i in range(n):
        dt[i] = time[i] - before
        before = time[i]
        longest = max(longest, dt[i])
        clips |= clipped[i] != 0.0
    least_std, unknown = np.inf, False
    lowest, highest = np.empty(3), np.empty(3)
    for axis in range(3):
        before = gyro[0, axis]
        total, low, high, jump = 0.0, before, before, (gyro[n - 1, axis] - before) / max(1, n - 1)
        for i in range(n):
            value = gyro[i, axis]
            total += value
            low, high = min(low, value), max(high, value)
        mean = total / n
        square, jitter = (before - mean) ** 2, 0.0
        for i in range(1, n):
            value = gyro[i, axis]
            square += (value - mean) ** 2
            jitter += (value - before - jump) ** 2
            before = value
        rows[MEAN, axis], rows[STD, axis] = mean, np.sqrt(square / (n - 1))
        rows[JITTER, axis], rows[HELD, axis] = np.sqrt(jitter / (n - 2)), 1.0 if low == high else 0.0
        least_std = min(least_std, rows[STD, axis])
        unknown = unknown or not np.isfinite(known[axis])
        lowest[axis], highest[axis] = low, high
        total = square = 0.0
        for i in range(n):
            total += accel[i, axis]
        mean = total / n
        for i in range(n):
            square += (accel[i, axis] - mean) ** 2
        rows[ACCEL_MEAN, axis], rows[ACCEL_STD, axis] = mean, np.sqrt(square / (n - 1))
    strength = 0.0
    for i in range(n):
        strength += np.sqrt(accel[i, 0] ** 2 + accel[i, 1] ** 2 + accel[i, 2] ** 2)
    rows[SCALARS, 0], rows[SCALARS, 1], rows[SCALARS, 2] = least_std, longest, strength / n
    for axis in range(3):
        step = known[axis]
        if least_std < coarsest or unknown:
            step = on_grid(gyro[:, axis], lowest[axis], highest[axis], known[axis])
            if np.isnan(step):
                ordered, step = np.sort(gyro[:, axis]), np.inf
                for i in range(1, n):
                    apart = ordered[i] - ordered[i - 1]
                    if 1e-9 < apart < step:
                        step = apart
            step = step_if_none if np.isinf(step) else step
            known[axis] = min(known[axis], step)
        common = step**2 / 12 if rows[STD, axis] < step / 2 else 0.0
        rows[STEP, axis], rows[COMMON_VAR, axis] = step, common
        rows[MEAN_VAR, axis] = rows[STD, axis] ** 2 / n + common
    return dt, rows, clips
