"""Orientation of devices, for many devices and cuts of samples in one call."""

from collections.abc import Sequence
from typing import NamedTuple

from estimator.device.batch_correction import Cut
from estimator.kernels.orientation import NEXT, ZERO
from estimator.orientation.attitude import Attitude, Oriented, orient
from estimator.state import Floats


class OrientedCut(NamedTuple):
    """Samples of a cut, and the attitude at each of them.

    zero: sequence number of the sample at which the heading was zero, and why (`start`, or who reset it).
    """

    cut: Cut
    attitudes: Oriented
    zero: tuple[int, str]


def oriented(due: Sequence[tuple[Attitude, Cut]], *, every: bool = False) -> list[OrientedCut]:
    """Integrate attitudes over cuts of samples, of any number of devices; return each cut with its attitudes.

    due: pairs of a device's attitude and its next cut; the cuts of a device in order. The bits do not depend on how the
    samples are batched. Samples that an attitude restored from a checkpoint has seen already are left out. every: see
    `orient`.
    """
    new, rows = list[tuple[Attitude, Cut]](), list[tuple[Attitude, Floats, Floats]]()
    for attitude, (samples, correction, begin, end) in due:
        state, next_ = attitude.state, int(attitude.state.item(NEXT))
        if samples.sequence + end <= next_:
            continue
        first = max(begin, next_ - samples.sequence)
        if not next_:
            state[ZERO] = samples.sequence + first
        state[NEXT] = samples.sequence + end
        new.append((attitude, Cut(samples, correction, first, end)))
        rows.append((attitude, samples.rows[first:end], correction.known))
    found = orient(rows, every=every)
    return [
        OrientedCut(cut, attitudes, (int(attitude.state.item(ZERO)), attitude.zero))
        for (attitude, cut), attitudes in zip(new, found, strict=True)
    ]
