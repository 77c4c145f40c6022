"""Kernels for the samples of many messages at once: unpack and check columns, and correct gyro readings."""

import numpy as np
from numpy.typing import NDArray

from estimator.kernels.compiled import Floats, compiled

Float32s = NDArray[np.float32]
Wholes = NDArray[np.int64]

#: rows of `numbers`, per message: number of samples; bytes of accel, °C and flags, 0 where absent; sequence number and
#: host time of the first sample
COUNT, ACCEL, CELSIUS, FLAGS, FIRST, START = range(6)


def vector(values: Float32s, limit: float, row: Floats) -> bool:
    """Copy a reading (3,) into row (3,); return True if each value is a number within ±limit, in the same unit."""
    fit = True
    for c in range(3):
        fit &= bool(abs(values[c]) <= limit)
        row[c] = values[c]
    return fit


def starts(numbers: Wholes, ticks: int) -> tuple[int, int, int, int]:
    """Indices of the first gyro, accelerometer, temperature and flags value in the memory of all messages.

    An index counts words of 32 bits from the start of this memory.
    numbers (6, m): message sizes, as for `unpacked`. ticks: number of clock ticks, 64 bits each, before these values.
    """
    gyro = 2 * ticks
    accel = gyro + 3 * ticks
    celsius = accel + numbers[ACCEL].sum() // 4
    return gyro, accel, celsius, celsius + numbers[CELSIUS].sum() // 4


def host_time(passed_ns: float, start: int, latest: float, place: Wholes) -> bool:
    """Write the host time of a sample, start + passed_ns, into place[1] if it is not after `latest`.

    start: host time of the message's first sample, ns since the Unix epoch. passed_ns: time from that sample on, ns.
    latest: largest permitted host time, ns since the Unix epoch.
    Returns True if the host time was written.
    """
    if not passed_ns <= latest - start:
        return False
    place[1] = start + np.int64(np.rint(passed_ns))
    return True


@compiled(
    "void(i8[:, :], f8[:, :], u8[:], f4[:], u4[:], f8[:], f8[:, :], i8[:, :], f8[:, :])",
    *(vector, starts, host_time),
)
def unpacked(
    numbers: Wholes,
    clocks: Floats,
    ticks: NDArray[np.uint64],
    floats: Float32s,
    words: NDArray[np.uint32],
    limits: Floats,
    rows: Floats,
    places: Wholes,
    found: Floats,
) -> None:
    """Unpack the samples of m messages into rows (n, 9) and places (n, 3) of samples/sample_buffer.py, with checks.

    rows, written: device time (s), gyro (3, rad/s), accelerometer (3, m/s²), clipped, temperature (°C).
    places, written: sequence number, host time (ns since the Unix epoch), flags.
    found (3, m), written: device time (s) of the first and last sample of each message, and 1 if all its samples are
    valid.
    clocks (2, m): tick period (s), and clock rate (host seconds per device second).
    ticks: the ticks of all messages one after the other, packed as on the wire. Behind them in memory follow all gyro,
        then all accelerometer, temperature and flags values.
    floats, words: views of the same memory as two types.

    numbers (6, m), per message:

        0         number of samples
        1, 2, 3   bytes of accelerometer, temperature and flags; 0 where absent
        4, 5      sequence number and host time (ns since the Unix epoch) of the first sample

    limits (7,):

        0, 1, 2, 3   largest gyro (rad/s), accelerometer (m/s²), temperature (°C) and host time (ns)
        4, 5, 6      masks of known flags, of flags for an unfit reading, and of flags for an unfit temperature
    """
    known, unfit, stepped = np.uint32(limits[4]), np.uint32(limits[5]), np.uint32(limits[6])
    gyro, accel, celsius, flags = starts(numbers, len(ticks))
    at = 0
    for message in range(numbers.shape[1]):
        n, first, start = numbers[COUNT, message], numbers[FIRST, message], numbers[START, message]
        aided, warm, marked = numbers[ACCEL, message] > 0, numbers[CELSIUS, message] > 0, numbers[FLAGS, message] > 0
        period, rate, begin, fit = clocks[0, message], clocks[1, message], ticks[at], True
        for i in range(n):
            row, place, tick = rows[at + i], places[at + i], ticks[at + i]
            fit &= tick < np.uint64(1 << 63) and (i == 0 or tick > ticks[at + i - 1])
            mark = words[flags + i] if marked else np.uint32(0)
            fit &= mark & ~known == 0
            row[0], row[4:7], row[7], row[8] = tick * period, np.nan, 1.0 if mark & unfit else 0.0, np.nan
            fit &= vector(floats[gyro + 3 * i : gyro + 3 * i + 3], limits[0], row[1:4])
            if aided:
                fit &= vector(floats[accel + 3 * i : accel + 3 * i + 3], limits[1], row[4:7])
            if warm:
                fit &= bool(abs(floats[celsius + i]) <= limits[2])
                row[8] = np.nan if mark & stepped else floats[celsius + i]
            passed_ns = np.float64(tick - begin) * period * rate * 1e9 if tick >= begin else np.inf
            fit &= host_time(passed_ns, start, limits[3], place)
            place[0], place[2] = first + i, mark
        found[0, message], found[1, message], found[2, message] = rows[at, 0], rows[at + n - 1, 0], 1.0 if fit else 0.0
        at += n
        gyro += 3 * n
        accel += numbers[ACCEL, message] // 4
        celsius += numbers[CELSIUS, message] // 4
        flags += numbers[FLAGS, message] // 4


@compiled("b1(f8[:, :], i8[:], f8[:, :], f8, f4[:, :], b1[:])")
def corrected(
    rows: Floats, counts: Wholes, parameters: Floats, limit: float, rate: Float32s, beyond: NDArray[np.bool_]
) -> bool:
    """Write corrected rates (n, 3), rad/s, of rows (n, 9), limited to ±limit; return True if any rate was beyond the limit.

    rows: device time (s), gyro (3, rad/s), accelerometer (3, m/s²), clipped, temperature (°C).
    counts (m,), parameters (m, 12): the first counts[0] rows use parameters[0], and so on. Each has the matrix (9, by
        rows) and the bias (3, rad/s).
    limit: rad/s. rate (n, 3), written: corrected rates. beyond (n,), written: True for samples that were limited.
    rate = matrix (reading - bias), summed from the left as in gyro_model.py. The results are the same to the last bit
    for any number of rows.
    """
    at, found = 0, False
    for m in range(len(counts)):
        own = parameters[m]
        for i in range(at, at + counts[m]):
            beyond[i] = False
            x, y, z = rows[i, 1] - own[9], rows[i, 2] - own[10], rows[i, 3] - own[11]
            for r in range(3):
                turn = np.float32(own[3 * r] * x + own[3 * r + 1] * y + own[3 * r + 2] * z)
                if not abs(turn) <= limit:
                    turn, beyond[i], found = np.float32(-limit if turn < 0 else limit), True, True
                rate[i, r] = turn
        at += counts[m]
    return found
