"""Finds rows of a recording that were written twice."""

import numpy as np
from numpy.typing import NDArray

from bridge.recording.recording import Floats

Flags = NDArray[np.bool_]
#: lags at which rows are compared, to estimate how often two are equal by chance
_LAGS = (5, 7, 11, 13)
#: repeats are believed only if chance explains less than this share of them
_BY_CHANCE = 0.05


def repeated(time: Floats, values: Floats) -> Flags:
    """Return a mask (n,) of the rows that were written twice.

    Such a row equals an earlier row in time (n,) and in all values (n, c).
    """
    return _seen_before(np.column_stack([time, values]))


def repeated_without_time(values: Floats) -> Flags:
    """Return a mask (n,) of the rows whose values (n, c) equal an earlier row's, if chance does not explain that."""
    n = len(values)
    none = np.zeros(n, bool)
    if n <= 2 * max(_LAGS):
        return none
    seen = _seen_before(values)
    equal = [np.mean(np.all(values[lag:] == values[:-lag], axis=1)) for lag in _LAGS]
    by_axis = [
        np.mean([np.mean(values[lag:, axis] == values[:-lag, axis]) for lag in _LAGS])
        for axis in range(values.shape[1])
    ]
    chance = max(float(np.prod(by_axis)), float(np.median(equal)))
    if seen.any() and n * n / 2 * chance < _BY_CHANCE * np.count_nonzero(seen):
        return seen
    after = np.concatenate([[False], np.all(values[1:] == values[:-1], axis=1)])
    if after.any() and n * chance < _BY_CHANCE * np.count_nonzero(after):
        return after
    return none


def _seen_before(rows: Floats) -> Flags:
    """Flag rows (n,) that equal the row before, or belong to a run that equals an earlier run.

    A single row that equals one further back is not flagged: a clipped or faulty sensor often reads the same again.
    """
    n = len(rows)
    # Adding zero gives -0.0 the same bits as 0.0.
    bits = np.ascontiguousarray(rows + 0.0).view(np.dtype((np.void, rows.dtype.itemsize * rows.shape[1]))).ravel()
    _, group = np.unique(bits, return_inverse=True)
    order = np.argsort(group, kind="stable")
    same = group[order[1:]] == group[order[:-1]]
    last = np.full(n, -1)
    last[order[1:][same]] = order[:-1][same]
    goes_on = np.concatenate([[False], (last[1:] == last[:-1] + 1) & (last[:-1] >= 0)])
    begins = np.concatenate([goes_on[1:], [False]])
    return np.asarray((last >= 0) & ((last == np.arange(n) - 1) | goes_on | begins))
