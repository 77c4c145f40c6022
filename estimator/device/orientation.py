"""Orientation of devices: integrates the attitudes of many devices over segments of samples in one call."""

from collections.abc import Sequence
from typing import NamedTuple

from estimator.device.batch_correction import Cut
from estimator.kernels.orientation import NEXT, ZERO
from estimator.orientation.attitude import Attitude, Oriented, orient
from estimator.state import Floats


class OrientedCut(NamedTuple):
    """Segment of samples, and the attitude at each sample.

    cut: the segment. attitudes: unit quaternions from sensor to earth axes (n, 4), with acceleration and covariance.
    zero: sequence number of the sample at which the heading was set to zero, and the name of the person who set it. The
    name is `start` if nobody has.
    """

    cut: Cut
    attitudes: Oriented
    zero: tuple[int, str]


def oriented(due: Sequence[tuple[Attitude, Cut]], *, every: bool = False) -> list[OrientedCut]:
    """Integrate attitudes over segments of samples, for any number of devices; return each segment with its attitudes.

    due: pairs of a device's attitude state and its next segment; the segments of one device in order.
    every: True for the covariance (rad²) at each sample, False for that at the last sample of each segment.
    Samples that a restored attitude has already processed are left out. The result does not depend, bit for bit, on how
    the samples are batched.
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
