"""The loop behind tracking/seconds.py: which windows make a second."""

import numpy as np
from numpy.typing import NDArray

from estimator.kernels.compiled import compiled

Floats = NDArray[np.float64]

#: room for windows that wait to see how it goes on: two of them are longer than 0.125 s, and none waits long
WAITING = 64


def nothing_gathered() -> tuple[Floats, Floats]:
    """The state (9,) ahead of the first window, and the room (WAITING, 6) for those that wait."""
    state = np.zeros(9)
    state[0] = -np.inf
    return state, np.empty((WAITING, 6))


def let_go(state: Floats, moved: float | None) -> None:
    """Of a state: what is gathered, what waits, and windows of which the last that was not still ended then, go by."""
    state[1] = state[2] = 0.0
    state[0] = state[0] if moved is None else moved


@compiled("f8[:, ::1](f8[:, :], i8, i8, f8[:, ::1], f8[:], UniTuple(f8, 3))")
def cut(
    found: Floats, first: int, begin: int, waiting: Floats, state: Floats, knobs: tuple[float, float, float]
) -> Floats:
    """(k, 5): the seconds that are known whole with the next windows, found (m, 22) by windows.py.

    A row: with which window, the second's first sample and the one behind its last, whether it is still, has an accelerometer.
    first: the number of the sample that `found` counts from, where the first window begins `begin` later.
    waiting: windows that wait: begin and end time, whether it is still if that lasts, first sample and the one behind its last,
    whether it has an accelerometer.
    state (9,): when the last window ended that was not still; how many wait; of the second that is gathered whether there is any
    of it, its begin, its first sample, whether its latest window is still, whether all are, whether all have an accelerometer;
    spikes in all windows so far.
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
        # A movement begins and ends too gently for windows to tell: what seems still waits to see how it goes on. Movement is
        # judged for good at once, and what waited is next to it.
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
