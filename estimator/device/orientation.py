"""Orientation of devices, for many devices and cuts of samples in one call."""

from collections.abc import Sequence
from typing import NamedTuple

from estimator.device.batch_correction import Cut
from estimator.kernels.orientation import NEXT, ZERO
from estimator.orientation.attitude import Attitude, Oriented, orient


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
    new, begun = list[tuple[Attitude, Cut]](), list[tuple[Attitude, Cut]]()
    for attitude, cut in due:
        seen = int(attitude.state.item(NEXT)) - cut.sequence
        if seen < cut.n:
            new.append((attitude, cut._replace(first=cut.first + seen) if seen > 0 else cut))
            if seen == -cut.sequence and not attitude.begun:
                begun.append(new[-1])
    rows = [(attitude, cut.samples.rows[cut.first : cut.end], cut.correction.known) for attitude, cut in new]
    found = orient(rows, every=every)
    for attitude, cut in reversed(begun):
        attitude.state[ZERO] = cut.sequence
    for attitude, cut in new:
        attitude.state[NEXT] = cut.sequence + cut.n
    return [OrientedCut(cut, attitudes, _zero(attitude)) for (attitude, cut), attitudes in zip(new, found, strict=True)]


def _zero(attitude: Attitude) -> tuple[int, str]:
    return int(attitude.state[ZERO]), attitude.zero
