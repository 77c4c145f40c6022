"""The loops behind service/together.py: samples out of the messages of a round, and corrected ones into others.

Messages of bridge/wire/columns.proto as Protocol Buffers encode them: of each field a tag, its number times 8 and its kind, then
8 bytes, or a varint (7 bits a byte, the lowest first), or a length as a varint and so many bytes.
"""

import numpy as np
from numpy.typing import NDArray

from estimator.loops.compiled import compiled

Floats = NDArray[np.float64]
Float32s = NDArray[np.float32]
Wholes = NDArray[np.int64]
Counts = NDArray[np.uint64]
Bytes = NDArray[np.uint8]

#: of a message's fields all but its samples' own, and their tags, take no more than this
MOST_OF_ONE = 56
_FIXED, _VARINT, _BYTES = 1, 0, 2
#: columns of `whole`: samples, the first of them, what is said of it, whether there are accel and °C; and of `real`
COUNT, FIRST, BOOT, SEQUENCE, RECEIVED, START, AIDED, WARM = range(8)
PERIOD, RATE, FIRST_S, LAST_S = range(4)


@compiled("void(u1[:], i8[:, :], u8[:], f8[:], u8[:, :], f8[:, :], u8[:], f4[:, :], f4[:, :], f4[:], f8[:, :])")
def unpacked(
    packed: Bytes,
    places: Wholes,
    most: Counts,
    limits: Floats,
    whole: Counts,
    real: Floats,
    ticks: Counts,
    gyro: Float32s,
    accel: Float32s,
    celsius: Float32s,
    rows: Floats,
) -> None:
    """Of messages (m, 2), each from boot on to its end, their samples one after the other, and what is said of each message.

    most (3): samples, sequence number, time; limits (3): of gyro, accel and °C. whole (m, 8): no samples where anything is unfit,
    or not as a bridge writes it: each field once, in their order. real (m, 4): tick period, clock rate, when the first and the
    last sample were taken, s. Then the columns of all, and their rows (n, 7), NaN where there is no accel.
    """

    def number(at: int, size: int) -> np.uint64:
        value = np.uint64(0)
        for i in range(size):
            value |= np.uint64(packed[at + i]) << np.uint64(8 * i)
        return value

    def single(at: int) -> np.float32:
        return np.uint32(number(at, 4)).view(np.float32)

    def double(at: int) -> np.float64:
        return np.uint64(number(at, 8)).view(np.float64)

    def varint(at: int, end: int, most: int) -> tuple[np.uint64, int]:
        """Where it ends, too. One of more than so many bytes is larger than any that fits: its last bit is kept."""
        value, shift = np.uint64(0), 0
        while at < end and packed[at] >= 0x80 and shift < 7 * (most - 1):
            value |= np.uint64(packed[at] & 0x7F) << np.uint64(shift)
            at, shift = at + 1, shift + 7
        if at < end:
            value |= np.uint64(packed[at]) << np.uint64(shift)
        return value, at + 1

    first, column, length = 0, np.empty(4, np.int64), np.empty(4, np.int64)
    for m in range(len(places)):
        whole[m, COUNT] = 0
        at, end = places[m]
        # Boot and sequence number; no fewer bytes than all these fields have with one sample.
        fit = end - at >= 9 + 2 + 4 * 9 + 2 + 8 + 2 + 12
        if not (fit and packed[at] == 8 * 3 + _FIXED and packed[at + 9] == 8 * 4 + _VARINT):
            continue
        boot = number(at + 1, 8)
        sequence, at = varint(at + 10, end, 9)
        # Receive and start time, tick period and clock rate.
        for field in range(4):
            fit &= packed[at + 9 * field] == 8 * (5 + field) + _FIXED
        received, started, period, rate = number(at + 1, 8), number(at + 10, 8), double(at + 19), double(at + 28)
        at += 36
        # Ticks, gyro, and accel and °C if there are any.
        for field in range(4):
            column[field] = length[field] = 0
            if end - at < 2 or packed[at] != 8 * (9 + field) + _BYTES:
                continue
            size, column[field] = varint(at + 1, end, 4)
            length[field] = np.int64(size)
            at = column[field] + length[field]
        n = length[0] // 8
        fit &= at == end and n >= 1 and np.uint64(n) <= most[0] and length[0] == 8 * n and length[1] == 12 * n
        fit &= (length[2] == 0 or length[2] == 12 * n) and (length[3] == 0 or length[3] == 4 * n)
        fit &= sequence <= most[1] and 0 < received < most[2] and 0 < started < most[2]
        if not (fit and 1e-9 <= period <= 1.0 and 1e-4 <= rate <= 1e4):
            continue
        before = np.uint64(0)
        for i in range(n):
            row, tick = first + i, number(column[0] + 8 * i, 8)
            fit &= (i == 0 or tick > before) and tick < np.uint64(1 << 63)
            ticks[row] = before = tick
            rows[row, 0] = tick * period
            for c in range(3):
                value = single(column[1] + 12 * i + 4 * c)
                fit &= abs(value) <= limits[0]
                gyro[row, c] = value
                rows[row, 1 + c] = value
                rows[row, 4 + c] = np.nan
                if length[2]:
                    value = single(column[2] + 12 * i + 4 * c)
                    fit &= abs(value) <= limits[1]
                    accel[row, c] = value
                    rows[row, 4 + c] = value
            if length[3]:
                celsius[row] = single(column[3] + 4 * i)
                fit &= abs(celsius[row]) <= limits[2]
        if fit:
            whole[m, COUNT], whole[m, FIRST], whole[m, BOOT], whole[m, SEQUENCE] = n, first, boot, sequence
            whole[m, RECEIVED], whole[m, START] = received, started
            whole[m, AIDED], whole[m, WARM] = length[2], length[3]
            real[m, PERIOD], real[m, RATE] = period, rate
            real[m, FIRST_S], real[m, LAST_S] = rows[first, 0], rows[first + n - 1, 0]
            first += n


@compiled("void(i8[:, :], f8[:, :], u8[:, :], f8[:, :], u8[:], f8[:, :], f8, u1[:], i8[:])")
def corrected(
    parts: Wholes,
    parameters: Floats,
    whole: Counts,
    real: Floats,
    ticks: Counts,
    rows: Floats,
    limit: float,
    packed: Bytes,
    ends: Wholes,
) -> None:
    """Parts of messages that came as messages of corrected rates have them, from sequence number to rates, and where each ends.

    parts (m, 3): which message of those `unpacked`, its first sample and its last; parameters (m, 12): matrix and bias. The rate
    of a reading is matrix (reading - bias), summed from the left as gyro.py does. A part with a rate beyond the limit is left
    empty.
    """

    def put(at: int, value: np.uint64, size: int) -> None:
        for i in range(size):
            packed[at + i] = np.uint8((value >> np.uint64(8 * i)) & np.uint64(0xFF))

    def put_varint(at: int, value: int) -> int:
        while value >= 0x80:
            packed[at] = (value & 0x7F) | 0x80
            at, value = at + 1, value >> 7
        packed[at] = value
        return at + 1

    end = 0
    for m in range(len(parts)):
        came, skipped, n = parts[m, 0], parts[m, 1], parts[m, 2] - parts[m, 1]
        at, own, begin = end, parameters[m], np.int64(whole[came, FIRST])
        period, rate = real[came, PERIOD], real[came, RATE]
        first, last = begin + skipped, begin + skipped + n
        sequence, started = np.int64(whole[came, SEQUENCE]) + skipped, np.int64(whole[came, START])
        # As sample_time_ns of block.py has it, to the bit.
        started += np.int64(np.rint(np.float64(ticks[first] - ticks[begin]) * period * rate * 1e9))
        packed[at] = 8 * 4 + _VARINT
        at = put_varint(at + 1, sequence)
        packed[at], packed[at + 9], packed[at + 18] = 8 * 5 + _FIXED, 8 * 6 + _FIXED, 8 * 7 + _FIXED
        put(at + 1, np.uint64(started), 8)
        put(at + 10, np.float64(period).view(np.uint64), 8)
        put(at + 19, np.float64(rate).view(np.uint64), 8)
        packed[at + 27] = 8 * 8 + _BYTES
        at = put_varint(at + 28, 8 * n)
        for i in range(first, last):
            put(at, ticks[i], 8)
            at += 8
        packed[at] = 8 * 9 + _BYTES
        at = put_varint(at + 1, 12 * n)
        fit = True
        for i in range(first, last):
            x, y, z = rows[i, 1] - own[9], rows[i, 2] - own[10], rows[i, 3] - own[11]
            for r in range(3):
                turn = np.float32(own[3 * r] * x + own[3 * r + 1] * y + own[3 * r + 2] * z)
                fit &= bool(abs(turn) <= limit)
                put(at, np.uint64(turn.view(np.uint32)), 4)
                at += 4
        end = at if fit else end
        ends[m] = end
