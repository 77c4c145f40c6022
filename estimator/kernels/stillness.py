"""Kernel of stillness/detector.py: cuts samples into windows, removes spikes, and judges each window as still or moving.

Unknown values are NaN.
"""

import numpy as np

from estimator.kernels.compiled import Floats, compiled

#: columns of the result of `judged`
TOLD, SUMMED, NOISE = 6, slice(7, 19), slice(19, 22)
#: latest windows of a rest from which its noise is estimated
RECENT = 16
#: most samples by which a window is extended so that it does not end at a spike
_SPIKE_AND_BACK = 2
#: ratio to the sample rate at which the noise was learnt, beyond which the device's output data rate was raised
_FASTER = 1.5


def nothing_known(noise_guess: float) -> tuple[Floats, Floats]:
    """Initial arguments of `judged`, before any sample: state (5, 4), and windows of the present rest (RECENT, 7).

    noise_guess: assumed standard deviation of one gyro reading at rest, rad/s.
    """
    state, recent = np.full((5, 4), np.nan), np.full((RECENT, 7), np.nan)
    state[1, 0], state[3, 1:] = 0.0, noise_guess
    return state, recent


def near(a: Floats, b: Floats, tolerance: float) -> bool:
    """Return True if two rates (3,) differ by less than `tolerance` (same unit) on every axis."""
    return bool(abs(a[0] - b[0]) < tolerance and abs(a[1] - b[1]) < tolerance and abs(a[2] - b[2]) < tolerance)


def window_end(time: Floats, read: Floats, begin: int, fewest: int, window_s: float, far: float) -> int:
    """Index after the last sample of the window that begins at index `begin`.

    The index is beyond the last sample where the window needs more samples.
    time (n,): s. read (n, 6): gyro (rad/s) and accelerometer (m/s²) readings.
    fewest, window_s: least number of samples, and least length in s, of a window.
    far: least step of a spike, rad/s; the window does not end at a spike.
    """
    held, end = len(time), begin
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
    return end


def summed(read: Floats, mean: Floats, std: Floats) -> None:
    """Write mean (6,) and standard deviation (6,) of readings (n, 6), n > 1: gyro in rad/s, and accelerometer in m/s²."""
    n = len(read)
    mean[:], std[:] = 0.0, 0.0
    for i in range(n):
        for c in range(6):
            mean[c] += read[i, c]
    for c in range(6):
        mean[c] /= n
    for i in range(n):
        for c in range(6):
            std[c] += (read[i, c] - mean[c]) ** 2
    for c in range(6):
        std[c] = np.sqrt(std[c] / (n - 1))


def mended(read: Floats, clipped: Floats, before: Floats, spikes: tuple[float, float, float]) -> int:
    """Replace spikes in the gyro columns of readings (n, 6) by their neighbours' mean; return how many samples had one.

    clipped (n,): flags, cleared for corrected samples. before (3,): the gyro reading before the first, rad/s.
    spikes: three limits for the distance of a reading from its neighbours' mean, all of which a spike exceeds. They are
        a rate in rad/s, a multiple of the median distance, and a multiple of the distances of both neighbours.
    """
    n, (far, unusual, alone) = len(read), spikes
    lone, around, off = np.zeros(n, np.bool_), np.empty(n + 1), np.zeros(n + 1)
    for c in range(3):
        around[0], around[1:] = before[c], read[:, c]
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
                read[i - 1, c] = 0.5 * (around[i - 1] + around[i + 1])
                lone[i - 1] = True
    for i in range(n):
        if lone[i]:  # a mended reading is no longer clipped
            clipped[i] = 0.0
    return int(lone.sum())


def broken(time: Floats, clipped: Floats, before: float, gap_s: float) -> tuple[bool, bool]:
    """Return two flags of a window: True for a gap of gap_s (s) or more between samples, and True for a clipped reading.

    time (n,) s, clipped (n,): of the window's samples. before: time of the sample before the window, s.
    """
    gap, cut_off = False, False
    for i in range(len(time)):
        gap |= time[i] - before >= gap_s
        cut_off |= clipped[i] != 0.0
        before = time[i]
    return gap, cut_off


def quiet(mean: Floats, std: Floats, rate_hz: float, noise: Floats, knobs: tuple[float, ...]) -> bool:
    """Return True if the readings of a window scatter no more than at rest, by the limits in `knobs`.

    mean, std (6,): of gyro (rad/s) and accelerometer (m/s²) readings; NaN without an accelerometer.
    rate_hz: sample rate in the window, Hz.
    noise (4,): sample rate (Hz) at which the noise was measured, and the noise (3): standard deviation of a reading at
        rest, rad/s.
    knobs (12,): limits, see `judged`.
    """
    _, _, factor, floor, jolt, _, _, ceiling, _, _, _, _ = knobs
    # At a higher output data rate a reading averages over less time: its noise is larger until learnt anew.
    denser = np.sqrt(rate_hz / noise[0]) if rate_hz > _FASTER * noise[0] else 1.0
    calm = np.isnan(mean[3]) or max(std[3], std[4], std[5]) <= jolt
    for c in range(3):
        calm &= not std[c] > min(max(factor * denser * noise[1 + c], floor), ceiling)
    return bool(calm)


def rests(mean: Floats, begun: float, ended: float, state: Floats, knobs: tuple[float, ...]) -> bool:
    """Return True if a quiet window belongs to a rest: its mean rate is near that of the last rest, and of this rest so far.

    A window at another rate also belongs to a rest, if such windows in a row have lasted long enough (`judged`, limit
    6).
    mean (3,): mean gyro reading, rad/s. begun, ended: device time of the window, s.
    state (5, 4), changed in place, and knobs (12,): see `judged`.
    """
    _, _, _, _, _, tolerance, new_s, _, _, _, _, _ = knobs
    rest, odd, reference = state[1], state[2], state[4, 1:]
    rested = np.isnan(reference[0]) or near(mean, reference, tolerance)
    if rested and (np.isnan(rest[1]) or near(mean, rest[1:], tolerance)):
        odd[:] = np.nan
        return True
    # Quiet but at another rate: an even turn, or a rest after an unobserved change of the bias.
    if rested:
        reference[:] = rest[1:]
    if np.isnan(odd[0]) or not near(mean, odd[1:], tolerance):
        odd[0], odd[1:] = begun, mean
    if ended - odd[0] < new_s:
        return False
    reference[:], odd[:] = mean, np.nan
    return True


def middle(values: Floats, lower: int) -> float:
    """Median of values (n,), n up to RECENT (16), in their unit.

    lower: for an even n, 1 gives the mean of the middle two values, and 0 the upper of the two.
    """
    known, ordered = len(values), np.empty(RECENT)
    for i in range(known):
        place = i
        while place > 0 and ordered[place - 1] > values[i]:
            ordered[place] = ordered[place - 1]
            place -= 1
        ordered[place] = values[i]
    return float(ordered[(known - lower) // 2] + ordered[known // 2]) / 2


def learnt(known: int, state: Floats, recent: Floats) -> bool:
    """Update the mean of the rest and the noise of the gyro from the latest windows of a rest.

    known: number of these windows; the noise needs eight.
    state (5, 4), changed in place, and recent (RECENT, 7): see `judged`.
    Returns True if the noise was updated.
    """
    rest, noise, reference = state[1], state[3], state[4, 1:]
    # The first windows of a stream may be the end of a movement: require several in a row.
    if known >= 4 or (known and not np.isnan(reference[0])):
        for c in range(3):
            reference[c] = recent[:known, c].mean()
        # The mean stays fixed after four windows, so that a slow turn does not drag it along.
        if known >= 4 and np.isnan(rest[1]):
            rest[1:] = reference
    if known < 8:
        return False
    for c in range(4):
        noise[c] = middle(recent[:known, 3 + c], min(c, 1))
    return True


@compiled(
    "f8[:, ::1](f8[:, ::1], f8[:, ::1], f8[:, ::1], UniTuple(f8, 12))",
    *(near, window_end, summed, mended, broken, quiet, rests, middle, learnt),
)
def judged(rows: Floats, state: Floats, recent: Floats, knobs: tuple[float, ...]) -> Floats:
    """Cut samples, rows (n, 9) of samples/sample_buffer.py, into windows and judge each as still or moving: result (m, 22).

    Spikes are replaced in the rows.
    state (5, 4), changed in place; each row has a number and three axes (rad/s):

        0   time (s) and reading of the last sample
        1   number of windows in this rest, and its mean after four of them
        2   start (s) and mean of a stretch that is quiet at another rate
        3   sample rate (Hz) at which the noise was measured, and the noise
        4   unused, and the mean of the last rest

    recent (RECENT, 7), changed in place: mean (3), sample rate (Hz) and standard deviation (3) of the latest windows of
    this rest. RECENT is 16.
    knobs (12,), limits:

        0, 1    least length (s), and least number of samples, of a window
        2, 3    largest standard deviation of gyro readings at rest: multiple of the noise, or rad/s if that is larger
        4       the same of accelerometer readings, m/s²
        5, 6    largest distance from the mean of a rest, rad/s; s after which another constant rate is a new rest
        7, 8    standard deviation above which any window moves, rad/s; gap between samples that ends a rest, s
        9..11   limits of a spike, see `mended`

    Columns of the result: start and end time (s); index after the last sample; number of spikes; flags still, has an
    accelerometer, noise was updated; mean (6) and standard deviation (6) of gyro (rad/s) and accelerometer (m/s²);
    noise (3), rad/s.
    """
    window_s, least, _, _, _, _, _, _, gap_s, far, unusual, alone = knobs
    last, rest, odd, noise = state[0], state[1], state[2], state[3]
    time, read, clipped = rows[:, 0], rows[:, 1:7], rows[:, 7]
    held, fewest, begin, found = len(time), int(least), 0, 0
    windows = np.empty((held // fewest, 22))
    while held - begin >= fewest and time[-1] - time[begin] >= window_s:
        end = window_end(time, read, begin, fewest, window_s, far)
        if end > held:
            break
        row, here = windows[found], read[begin:end]
        mean, std = row[7:13], row[13:19]
        n, begun, ended, spikes = end - begin, time[begin], time[end - 1], 0
        rate_hz = (n - 1) / (ended - begun) if ended > begun else 0.0
        summed(here, mean, std)
        if max(std[0], std[1], std[2]) * np.sqrt(2.0 * (n - 1)) > far:  # a reading may be a spike
            before = last[1:] if begun - last[0] < gap_s else here[0, :3].copy()
            spikes = mended(here, clipped[begin:end], before, (far, unusual, alone))
            if spikes:
                summed(here, mean, std)
        gap, cut_off = broken(time[begin:end], clipped[begin:end], last[0], gap_s)
        last[0], last[1:] = ended, read[end - 1, :3]
        still = not (gap or cut_off) and quiet(mean, std, rate_hz, noise, knobs)
        if gap or not (still or cut_off):
            odd[:] = np.nan
        still = still and rests(mean[:3], begun, ended, state, knobs)
        known = 0
        if still:
            latest = recent[int(rest[0]) % RECENT]
            latest[:3], latest[3], latest[4:] = mean[:3], rate_hz, std[:3]
            rest[0] += 1
            known = min(int(rest[0]), RECENT)
        else:
            rest[0], rest[1:] = 0.0, np.nan
        row[6] = learnt(known, state, recent)
        row[0], row[1], row[2], row[3] = begun, ended, end, spikes
        # A window with accelerometer readings in only a part of it is judged without them.
        row[4], row[5] = still, not np.isnan(mean[3])
        row[19:] = noise[1:]
        begin, found = end, found + 1
    return windows[:found]
