"""The loops behind service/together.py: samples out of the messages of a round, and corrected ones into others.

Messages of bridge/wire/columns.proto as Protocol Buffers encode them: of each field a tag, its number times 8 and its kind, then
8 bytes, or a varint (7 bits a byte, the lowest first), or a length as a varint and so many bytes.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.loops.compiled import compiled

Floats = NDArray[np.float64]
Wholes = NDArray[np.int64]
Counts = NDArray[np.uint64]
Bytes = NDArray[np.uint8]

#: of a message's fields all but its samples' own, and their tags, take no more than this
MOST_OF_ONE = 56
_FIXED, _VARINT, _BYTES = 1, 0, 2
#: s; samples that come closer to each other are looked at one by one
_CLOSEST_S = 5e-6
#: columns of `whole`: samples, the first of them, what is said of it, where in the messages its columns are, 0 where it has none,
#: and whether it goes on where its sender is; and of `real`
COUNT, FIRST, BOOT, SEQUENCE, RECEIVED, START, TICKS, GYRO, ACCEL, CELSIUS, AHEAD = range(11)
PERIOD, RATE, FIRST_S, LAST_S = range(4)
#: columns of a sender's numbers: bytes that its messages begin with; of a corrected one, bytes before its samples, and with those
#: behind them; its boot, and the sequence number that comes next, 0 where that is not known
NAME, BEGIN, ALL, OF_BOOT, NEXT = range(5)
#: and of its reals: device time, which goes on, of its latest sample; what it is ahead of the device's clock; before what time a
#: sample must be taken to go on; then matrix and bias
LATEST, SHIFT, UNTIL, PARAMETERS = range(4)


@compiled("void(u1[:], i8[:], i8[:], b1, u8[:], f8[:], u8[:, :], f8[:, :], u1[:, :], u8[:, :], f8[:, :], f8[:, :])")
def unpacked(
    packed: Bytes,
    sizes: Wholes,
    places: Wholes,
    goes_on: bool,  # noqa: FBT001 - the loops take no words
    most: Counts,
    limits: Floats,
    numbers: Counts,
    reals: Floats,
    begins: Bytes,
    whole: Counts,
    real: Floats,
    rows: Floats,
) -> None:
    """Of messages one after the other, m of these sizes, what is said of each, and the rows (n, 7) of their samples.

    places (m,): the senders, rows of numbers (k, 5), reals (k, 15) and begins (k, w); below 0 where it is nobody's. most (3):
    samples, sequence number, time; limits (3): of gyro, accel and °C. whole (m, 11): no samples where anything is unfit, or not
    as a bridge writes it: each field once, in their order. real (m, 4): tick period, clock rate, when the first and the last
    sample were taken, s. rows are NaN where there is no accel. With goes_on a sender whose message goes on is further by it; one
    whose message does not is nowhere.
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
    at: Any = 0
    end: Any = 0
    for m in range(len(sizes)):
        whole[m, COUNT] = whole[m, AHEAD] = 0
        at, end, place = end, end + sizes[m], places[m]
        if place < 0:
            continue
        name, awaited = np.int64(numbers[place, NAME]), numbers[place, NEXT]
        if goes_on:
            numbers[place, NEXT] = 0
        # No fewer bytes than all these fields have with one sample.
        fit = end - at >= name + 9 + 2 + 4 * 9 + 2 + 8 + 2 + 12
        if not fit:
            continue
        for i in range(name):
            fit &= packed[at + i] == begins[place, i]
        at += name
        # Boot and sequence number.
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
            before = tick
            rows[row, 0] = tick * period
            for c in range(3):
                value = single(column[1] + 12 * i + 4 * c)
                fit &= abs(value) <= limits[0]
                rows[row, 1 + c] = value
                rows[row, 4 + c] = np.nan
                if length[2]:
                    value = single(column[2] + 12 * i + 4 * c)
                    fit &= abs(value) <= limits[1]
                    rows[row, 4 + c] = value
            if length[3]:
                fit &= abs(single(column[3] + 4 * i)) <= limits[2]
        if not fit:
            continue
        whole[m, COUNT], whole[m, FIRST], whole[m, BOOT], whole[m, SEQUENCE] = n, first, boot, sequence
        whole[m, RECEIVED], whole[m, START] = received, started
        for field in range(4):
            whole[m, TICKS + field] = column[field] if length[field] else 0
        real[m, PERIOD], real[m, RATE] = period, rate
        first_s, last_s = rows[first, 0], rows[first + n - 1, 0]
        real[m, FIRST_S], real[m, LAST_S] = first_s, last_s
        first += n
        if goes_on and awaited and sequence == awaited and boot == numbers[place, OF_BOOT]:
            shift = reals[place, SHIFT]
            least_s, latest = n * _CLOSEST_S, reals[place, LATEST]
            if first_s + shift > latest and least_s <= last_s + shift - latest and last_s + shift < reals[place, UNTIL]:
                whole[m, AHEAD] = 1
                numbers[place, NEXT] = sequence + np.uint64(n)
                reals[place, LATEST] = last_s + shift


@compiled("void(u1[:], u8[:, :], f8[:, :], f8[:, :], i8[:, :], f8[:, :], u8[:, :], u1[:, :], f8, u1[:], i8[:])")
def corrected(
    came: Bytes,
    whole: Counts,
    real: Floats,
    rows: Floats,
    parts: Wholes,
    parameters: Floats,
    lengths: Counts,
    begins: Bytes,
    limit: float,
    packed: Bytes,
    ends: Wholes,
) -> None:
    """Parts of messages that came as messages of corrected rates have them, from sequence number to rates, and where each ends.

    parts (m, 4): which message of those `unpacked`, its first sample and its last, and a place. There stand parameters (12,),
    matrix and bias, and begins (w,), what is put before a part, up to the first of lengths (2,), and behind it, up to the second.
    The rate of a reading is matrix (reading - bias), summed from the left as gyro.py does. A part with a rate beyond the limit is
    left empty.
    """

    def put(at: int, value: np.uint64, size: int) -> None:
        for i in range(size):
            packed[at + i] = np.uint8((value >> np.uint64(8 * i)) & np.uint64(0xFF))

    def put_varint(at: int, value: Any) -> int:
        while value >= 0x80:
            packed[at] = (value & 0x7F) | 0x80
            at, value = at + 1, value >> 7
        packed[at] = value
        return at + 1

    def tick(at: Any) -> np.uint64:
        value = np.uint64(0)
        for i in range(8):
            value |= np.uint64(came[at + i]) << np.uint64(8 * i)
        return value

    at: Any = 0
    end: Any = 0
    for m in range(len(parts)):
        message, skipped, n, place = parts[m, 0], parts[m, 1], parts[m, 2] - parts[m, 1], parts[m, 3]
        at, own, before, behind = end, parameters[place], np.int64(lengths[place, 0]), np.int64(lengths[place, 1])
        period, rate, ticks = real[message, PERIOD], real[message, RATE], np.int64(whole[message, TICKS])
        first = np.int64(whole[message, FIRST]) + skipped
        sequence, started = np.int64(whole[message, SEQUENCE]) + skipped, np.int64(whole[message, START])
        # As sample_time_ns of block.py has it, to the bit.
        started += np.int64(np.rint(np.float64(tick(ticks + 8 * skipped) - tick(ticks)) * period * rate * 1e9))
        for i in range(before):
            packed[at + i] = begins[place, i]
        at += before
        packed[at] = 8 * 4 + _VARINT
        at = put_varint(at + 1, sequence)
        packed[at], packed[at + 9], packed[at + 18] = 8 * 5 + _FIXED, 8 * 6 + _FIXED, 8 * 7 + _FIXED
        put(at + 1, np.uint64(started), 8)
        put(at + 10, np.float64(period).view(np.uint64), 8)
        put(at + 19, np.float64(rate).view(np.uint64), 8)
        packed[at + 27] = 8 * 8 + _BYTES
        at = put_varint(at + 28, 8 * n)
        for i in range(8 * n):
            packed[at + i] = came[ticks + 8 * skipped + i]
        at += 8 * n
        packed[at] = 8 * 9 + _BYTES
        at = put_varint(at + 1, 12 * n)
        fit = True
        for i in range(first, first + n):
            x, y, z = rows[i, 1] - own[9], rows[i, 2] - own[10], rows[i, 3] - own[11]
            for r in range(3):
                turn = np.float32(own[3 * r] * x + own[3 * r + 1] * y + own[3 * r + 2] * z)
                fit &= bool(abs(turn) <= limit)
                put(at, np.uint64(turn.view(np.uint32)), 4)
                at += 4
        for i in range(before, behind):
            packed[at + i - before] = begins[place, i]
        at += behind - before
        end = at if fit else end
        ends[m] = end
