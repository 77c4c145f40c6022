"""Kernel of tracking/seconds.py: statistics of the readings in a block of one second: mean, scatter, rounding step."""

import numpy as np

from estimator.kernels.compiled import Floats, compiled

#: most rounding steps that a grid may span, and largest distance from the grid, in steps: beyond, the step is finer
_LEVELS, _OFF_GRID = 512, 0.1
#: rows of the result of `measured`
MEAN, STD, STEP, MEAN_VAR, COMMON_VAR, JITTER, HELD, ACCEL_MEAN, ACCEL_STD, SCALARS, CELSIUS = range(11)


def timed(time: Floats, first: float, dt: Floats) -> float:
    """Write the sample intervals dt (n,), s, of samples at time (n,), s, after a sample at time `first`; return the longest."""
    before, longest = first, -np.inf
    for i in range(len(time)):
        dt[i] = time[i] - before
        before = time[i]
        longest = max(longest, dt[i])
    return longest


def spread(read: Floats) -> tuple[float, float]:
    """Mean and standard deviation, in the unit of the readings (n,), n > 1."""
    n, total, square = len(read), 0.0, 0.0
    for i in range(n):
        total += read[i]
    mean = total / n
    for i in range(n):
        square += (read[i] - mean) ** 2
    return mean, np.sqrt(square / (n - 1))


def jittered(read: Floats) -> tuple[float, float, float]:
    """Minimum and maximum of readings (n,), n > 2, and standard deviation of the steps between neighbours; all in their unit.

    The steps are taken about their mean, so that a steady drift does not count.
    """
    n, low, high, jitter = len(read), read[0], read[0], 0.0
    jump = (read[n - 1] - read[0]) / max(1, n - 1)
    for i in range(1, n):
        low, high = min(low, read[i]), max(high, read[i])
        jitter += (read[i] - read[i - 1] - jump) ** 2
    return low, high, np.sqrt(jitter / (n - 2))


def on_grid(read: Floats, low: float, high: float, grid: float) -> float:
    """Smallest difference between distinct readings (n,) that lie on multiples of `grid` above the lowest reading.

    low, high: lowest and highest reading. grid: assumed rounding step. All, and the result, are in the readings' unit.
    Returns infinity where all readings are equal. Returns NaN where they are not multiples, or where they span more
    than 512 steps.
    """
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


def stepped(read: Floats, low: float, high: float, known: float, step_if_none: float) -> float:
    """Rounding step of readings (n,): the smallest difference between distinct values; `step_if_none` where all are equal.

    low, high: lowest and highest reading. known: smallest step known before, tried first. All in the readings' unit.
    """
    step = on_grid(read, low, high, known)
    if np.isnan(step):
        ordered, step = np.sort(read), np.inf
        for i in range(1, len(read)):
            apart = ordered[i] - ordered[i - 1]
            if 1e-9 < apart < step:
                step = apart
    return step_if_none if np.isinf(step) else step


def strength(accel: Floats) -> float:
    """Mean magnitude of accelerometer readings (n, 3), m/s²; NaN where any reading is NaN."""
    total = 0.0
    for i in range(len(accel)):
        total += np.sqrt(accel[i, 0] ** 2 + accel[i, 1] ** 2 + accel[i, 2] ** 2)
    return total / len(accel)


def mean_of_known(celsius: Floats) -> float:
    """Mean of the temperatures (n,), °C, without those that are NaN; NaN where all are."""
    total, known = 0.0, 0
    for i in range(len(celsius)):
        if not np.isnan(celsius[i]):
            total += celsius[i]
            known += 1
    return total / known if known else np.nan


@compiled(
    "Tuple((f8[::1], f8[:, ::1], b1))(f8[:, ::1], f8, f8, f8, f8[:])",
    *(timed, spread, jittered, on_grid, stepped, strength, mean_of_known),
)
def measured(
    samples: Floats, first: float, coarsest: float, step_if_none: float, known: Floats
) -> tuple[Floats, Floats, bool]:
    """Statistics of the samples of a one-second block: dt (n,) in s, rows (11, 3), and True if a sample is clipped.

    samples (n, 9): rows of samples/sample_buffer.py. first: time of the sample before the block, s.
    coarsest: rad/s; where the standard deviation of every axis is above it, the rounding step is taken from `known`.
    step_if_none: rounding step where no two readings differ, rad/s.
    known (3,), updated: smallest rounding step so far, rad/s.
    Rows of the result, one column per axis, gyro in rad/s and accelerometer in m/s²:

        MEAN, STD               mean and standard deviation of the gyro readings
        STEP                    rounding step
        MEAN_VAR, COMMON_VAR    variance of the mean, and its part from rounding, (rad/s)²: see gyro_model.py
        JITTER                  standard deviation of the steps between neighbouring readings
        HELD                    1 where all readings are equal
        ACCEL_MEAN, ACCEL_STD   mean and standard deviation of the accelerometer; NaN without one
        SCALARS                 not per axis: least STD, longest dt (s), mean magnitude of the accelerometer readings
        CELSIUS                 mean of the known temperatures, °C, in the first column; NaN without any
    """
    gyro, accel = samples[:, 1:4], samples[:, 4:7]
    dt, rows, n = np.empty(len(samples)), np.zeros((11, 3)), len(samples)
    longest, unknown = timed(samples[:, 0], first, dt), False
    lowest, highest = np.empty(3), np.empty(3)
    for axis in range(3):
        rows[MEAN, axis], rows[STD, axis] = spread(gyro[:, axis])
        lowest[axis], highest[axis], rows[JITTER, axis] = jittered(gyro[:, axis])
        rows[HELD, axis] = 1.0 if lowest[axis] == highest[axis] else 0.0
        rows[ACCEL_MEAN, axis], rows[ACCEL_STD, axis] = spread(accel[:, axis])
        unknown = unknown or not np.isfinite(known[axis])
    least_std = min(rows[STD, 0], rows[STD, 1], rows[STD, 2])
    for axis in range(3):
        step = known[axis]
        if least_std < coarsest or unknown:
            step = stepped(gyro[:, axis], lowest[axis], highest[axis], step, step_if_none)
            known[axis] = min(known[axis], step)
        common = step**2 / 12 if rows[STD, axis] < step / 2 else 0.0
        rows[STEP, axis], rows[COMMON_VAR, axis] = step, common
        rows[MEAN_VAR, axis] = rows[STD, axis] ** 2 / n + common
    rows[SCALARS, 0], rows[SCALARS, 1], rows[SCALARS, 2] = least_std, longest, strength(accel)
    rows[CELSIUS, 0] = mean_of_known(samples[:, 8])
    return dt, rows, bool(samples[:, 7].any())
