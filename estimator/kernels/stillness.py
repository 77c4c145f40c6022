"""Kernel of stillness/detector.py: cuts samples into windows, mends spikes, and judges each window. Unknown values are NaN."""

import numpy as np
from numpy.typing import NDArray

from estimator.kernels.compiled import compiled

Floats = NDArray[np.float64]

#: columns of the result of `judged`
TOLD, SUMMED, NOISE = 6, slice(7, 19), slice(19, 22)
#: latest windows of a rest from which its noise is estimated
RECENT = 16
#: most samples by which a window is extended so that it does not end at a spike
_SPIKE_AND_BACK = 2
#: ratio to the sample rate at which the noise was learnt, beyond which the device's output data rate was raised
_FASTER = 1.5


def nothing_known(noise_guess: float) -> tuple[Floats, Floats]:
    """Initial state (5, 4) and recent windows (RECENT, 7), with an assumed noise, rad/s."""
    state, recent = np.full((5, 4), np.nan), np.full((RECENT, 7), np.nan)
    state[1, 0], state[3, 1:] = 0.0, noise_guess
    return state, recent


@compiled("f8[:, ::1](f8[:, ::1], f8[:, ::1], f8[:, ::1], UniTuple(f8, 12))")
def judged(rows: Floats, state: Floats, recent: Floats, knobs: tuple[float, ...]) -> Floats:
    """Judged windows (m, 22) of samples, rows (n, 9) of samples/sample_buffer.py; spikes are mended in the rows.

    A row: begin and end time, index after its last sample, spikes; flags: still, has an accelerometer, contributed to
    the noise estimate; mean (6), std (6); noise (3).
    state (5, 4), each row a number and three axes: time and reading of the last sample; number of windows in this rest,
    and its mean after four of them; begin and mean of a stretch that is quiet at another rate; sample rate at which the
    noise was learnt, and the noise; unused, and the mean of the last rest.
    recent (RECENT, 7): mean, rate and std of the latest windows of this rest.
    """
    window_s, least, factor, floor, jolt, tolerance, new_s, ceiling, gap_s, far, unusual, alone = knobs
    last, rest, odd, noise, reference = state[0], state[1], state[2], state[3], state[4, 1:]

    def near(a: Floats, b: Floats) -> bool:
        return bool(abs(a[0] - b[0]) < tolerance and abs(a[1] - b[1]) < tolerance and abs(a[2] - b[2]) < tolerance)

    time, read, clipped = rows[:, 0], rows[:, 1:7], rows[:, 7]
    held, fewest, begin, found = len(time), int(least), 0, 0
    windows, ordered = np.empty((held // fewest, 22)), np.empty(RECENT)
    while held - begin >= fewest and time[-1] - time[begin] >= window_s:
        end = begin
        while end < held and time[end] < time[begin] + window_s:
            end += 1
        end = max(end + 1, begin + fewest)
        # A window does not end at a spike: only the readings after a spike show that it is one.
        for _ in range(_SPIKE_AND_BACK):
            if end > held:
                break
            leap = 0.0
            for c in range(3):
                leap = max(leap, abs(read[end - 1, c] - read[end - 2, c]))
            if leap <= far:
                break
            end += 1
        if end > held:
            break
        row = windows[found]
        mean, std = row[7:13], row[13:19]
        n, begun, ended = end - begin, time[begin], time[end - 1]
        rate_hz = (n - 1) / (ended - begun) if ended > begun else 0.0

        spikes = 0
        for again in range(2):
            mean[:], std[:] = 0.0, 0.0
            for i in range(begin, end):
                for c in range(6):
                    mean[c] += read[i, c]
            for c in range(6):
                mean[c] /= n
            for i in range(begin, end):
                for c in range(6):
                    std[c] += (read[i, c] - mean[c]) ** 2
            for c in range(6):
                std[c] = np.sqrt(std[c] / (n - 1))
            if again or max(std[0], std[1], std[2]) * np.sqrt(2.0 * (n - 1)) <= far:
                break  # no reading can be a spike
            lone = np.zeros(n, np.bool_)
            for c in range(3):
                around, off = np.empty(n + 1), np.zeros(n + 1)
                around[0] = last[1 + c] if begun - last[0] < gap_s else read[begin, c]
                around[1:] = read[begin:end, c]
                # The last reading has only one neighbour and is never taken for a spike.
                for i in range(1, n):
                    off[i] = abs(around[i] - 0.5 * (around[i - 1] + around[i + 1]))
                usual = np.median(off[1:n])
                for i in range(1, n):
                    # At a step, or at two equal readings, the neighbours differ by twice as much.
                    agreed = off[i] > abs(around[i + 1] - around[i - 1])
                    # A spike also spoils its neighbours' means, by half of itself.
                    by_itself = off[i] > alone * max(off[i - 1], off[i + 1])
                    if agreed and by_itself and off[i] > max(far, unusual * usual):
                        read[begin + i - 1, c] = 0.5 * (around[i - 1] + around[i + 1])
                        lone[i - 1] = True
            spikes = lone.sum()
            for i in range(n):
                if lone[i]:  # a mended reading is no longer clipped
                    clipped[begin + i] = 0.0
            if not spikes:
                break

        gap, cut_off, before = False, False, last[0]
        for i in range(begin, end):
            gap |= time[i] - before >= gap_s
            cut_off |= clipped[i] != 0.0
            before = time[i]
        last[0], last[1:] = ended, read[end - 1, :3]
        if gap:
            odd[:] = np.nan
        # A window with accelerometer readings in only a part of it is judged without them.
        aided, still = not np.isnan(mean[3]), False
        if not (gap or cut_off):
            quiet = not aided or max(std[3], std[4], std[5]) <= jolt
            # At a higher output data rate a reading averages over less time: its noise is larger until learnt anew.
            denser = np.sqrt(rate_hz / noise[0]) if rate_hz > _FASTER * noise[0] else 1.0
            for c in range(3):
                quiet &= not std[c] > min(max(factor * denser * noise[1 + c], floor), ceiling)
            rested = np.isnan(reference[0]) or near(mean, reference)
            if not quiet:
                odd[:] = np.nan
            elif rested and (np.isnan(rest[1]) or near(mean, rest[1:])):
                odd[:] = np.nan
                still = True
            else:
                # Quiet but at another rate: an even turn, or a rest after an unobserved change of the bias.
                if rested:
                    reference[:] = rest[1:]
                if np.isnan(odd[0]) or not near(mean, odd[1:]):
                    odd[0], odd[1:] = begun, mean[:3]
                if ended - odd[0] >= new_s:
                    reference[:], odd[:] = mean[:3], np.nan
                    still = True

        known = 0
        if still:
            latest = recent[int(rest[0]) % RECENT]
            latest[:3], latest[3], latest[4:] = mean[:3], rate_hz, std[:3]
            rest[0] += 1
            known = min(int(rest[0]), RECENT)
        else:
            rest[0], rest[1:] = 0.0, np.nan
        # The first windows of a stream may be the end of a movement: require several in a row.
        if known >= 4 or (still and not np.isnan(reference[0])):
            for c in range(3):
                reference[c] = recent[:known, c].mean()
            # The mean stays fixed after four windows, so that a slow turn does not drag it along.
            if known >= 4 and np.isnan(rest[1]):
                rest[1:] = reference
        told = known >= 8
        if told:
            for c in range(4):
                for i in range(known):
                    value, place = recent[i, 3 + c], i
                    while place > 0 and ordered[place - 1] > value:
                        ordered[place] = ordered[place - 1]
                        place -= 1
                    ordered[place] = value
                noise[c] = ordered[known // 2] if c == 0 else (ordered[(known - 1) // 2] + ordered[known // 2]) / 2
        row[0], row[1], row[2], row[3] = begun, ended, end, spikes
        row[4], row[5], row[6] = still, aided, told
        row[19:] = noise[1:]
        begin, found = end, found + 1
    return windows[:found]
