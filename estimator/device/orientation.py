"""Orientation of devices from the cuts of a round."""

from collections.abc import Sequence
from typing import NamedTuple

from estimator.device.batch_correction import Cut
from estimator.kernels.orientation import NEXT
from estimator.orientation.attitude import Attitude, Oriented, orient


class OrientedCut(NamedTuple):
    """Samples of a cut and their attitudes."""

    cut: Cut
    attitudes: Oriented


def oriented(due: Sequence[tuple[Attitude, Cut]]) -> list[OrientedCut]:
    """Carry attitudes over the cuts of a round, in order; the bits do not depend on how the samples are batched.

    Samples that an attitude restored from a checkpoint has seen already are left out.
    """
    new = [(attitude, cut._replace(first=_first(attitude, cut))) for attitude, cut in due]
    new = [(attitude, cut) for attitude, cut in new if cut.n > 0]
    found = orient([(attitude, cut.samples.rows[cut.first : cut.end], cut.correction.known) for attitude, cut in new])
    for attitude, cut in new:
        attitude.state[NEXT] = cut.sequence + cut.n
    return [OrientedCut(cut, attitudes) for (_, cut), attitudes in zip(new, found, strict=True)]


def _first(attitude: Attitude, cut: Cut) -> int:
    """Index of the first sample of a cut that the attitude has not seen."""
    return max(cut.first, min(cut.end, int(attitude.state[NEXT]) - cut.samples.sequence))
