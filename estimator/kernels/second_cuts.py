"""Kernel of tracking/seconds.py: joins stillness windows, each of about 1/8 s, into blocks of one second."""

import numpy as np

from estimator.kernels.compiled import Floats, compiled

#: capacity for windows that wait for a judgement: any two together last more than 0.125 s, and no window waits long
WAITING = 64


def nothing_gathered() -> tuple[Floats, Floats]:
    """Initial arguments of `cut`: state (9,) without an unfinished block, and empty storage (WAITING, 6) for waiting windows."""
    state = np.zeros(9)
    state[0] = -np.inf
    return state, np.empty((WAITING, 6))


def let_go(state: Floats, moved: float | None) -> None:
    """Discard the unfinished block and the waiting windows, because the windows that follow are skipped.

    state (9,): state of `cut`, changed in place.
    moved: device time at the end of the last moving window among those skipped, s, or None.
    """
    state[1] = state[2] = 0.0
    state[0] = state[0] if moved is None else moved


@compiled("f8[:, ::1](f8[:, :], i8, i8, f8[:, ::1], f8[:], UniTuple(f8, 3))")
def cut(
    found: Floats, first: int, begin: int, waiting: Floats, state: Floats, knobs: tuple[float, float, float]
) -> Floats:
    """Join stillness windows, in order, into blocks of one second; return one row (5) for each of k completed blocks.

    found (m, 22): judged windows, as `judged` in kernels/stillness.py returns them. All times are device time, s.
    first: number of the sample to which index 0 in `found` refers. begin: index of the first window's first sample.
    knobs (3,): length of a block, its least length, and settling time, all in s. Within the settling time before or
        after a movement, no window is still.
    Each result row: index of the window that completes the block, number of its first sample, number of the sample
    after its last, 1 if still, 1 with an accelerometer.

    waiting (WAITING, 6), changed in place, has one row per waiting window:

        0, 1   start and end time
        2      1 if the window is still, provided that the stillness lasts
        3, 4   numbers of its first sample and of the one after its last
        5      1 with an accelerometer

    state (9,), changed in place:

        0      end time of the last moving window
        1      number of waiting windows
        2      1 if a block is unfinished; the next five values describe it
        3, 4   start time, and number of its first sample
        5, 6   1 if its latest window is still; 1 if all its windows are still
        7      1 if all its windows have an accelerometer
        8      number of spikes in all windows so far
    """

    def close(row: Floats, window: int, behind: float) -> None:
        row[0], row[1], row[2], row[3], row[4] = window, state[4], behind, state[6], state[7]
        state[2] = 0.0

    length_s, least_s, settle_s = knobs
    whole = np.empty((2 * (len(found) + int(state[1])), 5))
    begin, closed = first + begin, 0
    for i in range(len(found)):
        now, still, held = found[i, 1], found[i, 4] != 0.0, int(state[1])
        if not still:
            state[0] = now
        new = waiting[held]
        new[0], new[1], new[3], new[5] = found[i, 0], now, begin, found[i, 5]
        begin = first + int(found[i, 2])
        new[2], new[4] = new[0] - state[0] >= settle_s, begin
        held, judged = held + 1, 0
        # A movement begins and ends too gently for one window to show, so a window that seems still waits for later
        # ones.
        # A moving window is final at once, and so are the waiting windows beside it.
        while judged < held and not (still and waiting[judged, 2] != 0.0 and now - waiting[judged, 1] < settle_s):
            of = waiting[judged]
            so_still = still and of[2] != 0.0
            if state[2] != 0.0 and (state[5] != 0.0) != so_still and of[0] - state[3] >= least_s:
                close(whole[closed], i, of[3])
                closed += 1
            if state[2] == 0.0:
                state[2], state[3], state[4], state[6], state[7] = 1.0, of[0], of[3], 1.0, 1.0
            state[5] = so_still
            state[6] *= so_still
            state[7] *= of[5]
            if of[1] - state[3] >= length_s:
                close(whole[closed], i, of[4])
                closed += 1
            judged += 1
        for k in range(judged, held):
            waiting[k - judged] = waiting[k]
        state[1] = held - judged
        state[8] += found[i, 3]
    return whole[:closed]
