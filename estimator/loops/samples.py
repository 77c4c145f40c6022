"""The loops over the samples of a round: packed columns into rows, checked; and readings into corrected rates."""

import numpy as np
from numpy.typing import NDArray

from estimator.loops.compiled import compiled

Floats = NDArray[np.float64]
Float32s = NDArray[np.float32]
Wholes = NDArray[np.int64]

#: rows of the `numbers` of messages: samples; 0 where one has no accel, °C, flags; sequence number and host time of the first
COUNT, HAS_ACCEL, HAS_CELSIUS, HAS_FLAGS, FIRST, START = range(6)


@compiled("b1[:](i8[:, :], f8[:, :], u8[:], f4[:], f4[:], f4[:], u4[:], f8[:], u4[:], f8[:, :], i8[:, :], f8[:, :])")
def unpacked(
    numbers: Wholes,
    clocks: Floats,
    ticks: NDArray[np.uint64],
    gyro: Float32s,
    accel: Float32s,
    celsius: Float32s,
    flags: NDArray[np.uint32],
    limits: Floats,
    marks: NDArray[np.uint32],
    rows: Floats,
    places: Wholes,
    ends: Floats,
) -> NDArray[np.bool_]:
    """(m,): which messages are fit. Writes rows (n, 9) and places (n, 3) of all samples; see estimator/device/samples.py.

    And ends (2, m), the device time of the first sample of each message and of the last.

    numbers (6, m); clocks (2, m): tick period, s, and rate. The columns of all messages lie one after the other, packed as on the
    wire. limits: largest gyro, accel, °C and host time. marks: all flags there are; those that make a reading unfit, and its °C.
    """
    known, unfit, stepped = marks[0], marks[1], marks[2]
    most_gyro, most_accel, most_celsius, most_ns = limits[0], limits[1], limits[2], limits[3]
    fits = np.ones(numbers.shape[1], np.bool_)
    at, accel_at, celsius_at, flags_at = 0, 0, 0, 0
    for m in range(numbers.shape[1]):
        n, first, start = numbers[COUNT, m], numbers[FIRST, m], numbers[START, m]
        period, rate, fit = clocks[0, m], clocks[1, m], True
        begin = ticks[at]
        for i in range(n):
            row, place, tick = rows[at + i], places[at + i], ticks[at + i]
            fit &= tick < np.uint64(1 << 63) and (i == 0 or tick > ticks[at + i - 1])
            row[0] = tick * period
            for c in range(3):
                value = gyro[3 * (at + i) + c]
                fit &= bool(abs(value) <= most_gyro)
                row[1 + c] = value
                row[4 + c] = np.nan
                if numbers[HAS_ACCEL, m]:
                    value = accel[accel_at + 3 * i + c]
                    fit &= bool(abs(value) <= most_accel)
                    row[4 + c] = value
            mark = flags[flags_at + i] if numbers[HAS_FLAGS, m] else np.uint32(0)
            fit &= mark & ~known == 0
            row[7] = 1.0 if mark & unfit else 0.0
            row[8] = np.nan
            if numbers[HAS_CELSIUS, m]:
                value = celsius[celsius_at + i]
                fit &= bool(abs(value) <= most_celsius)
                if not mark & stepped:
                    row[8] = value
            passed_ns = np.float64(tick - begin) * period * rate * 1e9 if tick >= begin else np.inf
            if passed_ns <= most_ns - start:
                place[1] = start + np.int64(np.rint(passed_ns))
            else:
                fit = False
            place[0], place[2] = first + i, mark
        fits[m], ends[0, m], ends[1, m] = fit, rows[at, 0], rows[at + n - 1, 0]
        at += n
        accel_at += 3 * n if numbers[HAS_ACCEL, m] else 0
        celsius_at += n if numbers[HAS_CELSIUS, m] else 0
        flags_at += n if numbers[HAS_FLAGS, m] else 0
    return fits


@compiled("void(f8[:, :], i8[:], f8[:, :], f8, f4[:, :], b1[:])")
def corrected(
    rows: Floats, counts: Wholes, parameters: Floats, limit: float, rate: Float32s, beyond: NDArray[np.bool_]
) -> None:
    """Writes corrected rates (n, 3) of rows (n, 9), and which are beyond the limit (n,), at which they then stand.

    The first of counts (m,) are corrected by the first of parameters (m, 12), matrix and bias, and so on: rate = matrix
    (reading - bias), summed from the left as gyro.py does. The bits are the same however many are corrected at once.
    """
    at = 0
    for m in range(len(counts)):
        own = parameters[m]
        for i in range(at, at + counts[m]):
            x, y, z = rows[i, 1] - own[9], rows[i, 2] - own[10], rows[i, 3] - own[11]
            for r in range(3):
                turn = np.float32(own[3 * r] * x + own[3 * r + 1] * y + own[3 * r + 2] * z)
                if not abs(turn) <= limit:
                    turn, beyond[i] = np.float32(-limit if turn < 0 else limit), True
                rate[i, r] = turn
        at += counts[m]
