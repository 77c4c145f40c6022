"""Orientation of devices from the cuts of a round."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bridge.wire.batches import MAX_ACCEL
from bridge.wire.messages import OrientationBatch
from estimator.device.batch_correction import Cut
from estimator.kernels.orientation import NEXT, ZERO
from estimator.orientation.attitude import Attitude, Oriented, orient

_ROWS, _COLUMNS = np.triu_indices(3)


class OrientedCut(NamedTuple):
    """Samples of a cut and their attitudes; zero: number of the sample at which the heading was zero, and why."""

    cut: Cut
    attitudes: Oriented
    zero: tuple[int, str]


def oriented(due: Sequence[tuple[Attitude, Cut]]) -> list[OrientedCut]:
    """Carry attitudes over the cuts of a round, in order; the bits do not depend on how the samples are batched.

    Samples that an attitude restored from a checkpoint has seen already are left out.
    """
    new = [(attitude, cut._replace(first=_first(attitude, cut))) for attitude, cut in due]
    new = [(attitude, cut) for attitude, cut in new if cut.n > 0]
    begun = [(attitude, cut) for attitude, cut in reversed(new) if not attitude.begun]
    found = orient([(attitude, cut.samples.rows[cut.first : cut.end], cut.correction.known) for attitude, cut in new])
    for attitude, cut in begun:
        attitude.state[ZERO] = cut.sequence
    for attitude, cut in new:
        attitude.state[NEXT] = cut.sequence + cut.n
    return [OrientedCut(cut, attitudes, _zero(attitude)) for (attitude, cut), attitudes in zip(new, found, strict=True)]


def batch_of(oriented: OrientedCut, epoch: int) -> OrientationBatch:
    """Message with the orientation of a cut."""
    (samples, correction, *_), attitudes = oriented.cut, oriented.attitudes
    covariance = np.empty((3, 3), np.float32)
    covariance[_ROWS, _COLUMNS] = covariance[_COLUMNS, _ROWS] = attitudes.cov[-1]
    aided = bool(np.isfinite(attitudes.accel).all())
    return OrientationBatch(
        device=samples.device,
        boot=samples.boot,
        sequence=oriented.cut.sequence,
        start_time_ns=oriented.cut.start_time_ns,
        tick_period_s=samples.tick_period_s,
        clock_rate=samples.clock_rate,
        ticks=np.frombuffer(oriented.cut.ticks, np.uint64),
        quat_wxyz=attitudes.quat_wxyz.astype(np.float32),
        linear_accel=np.clip(attitudes.accel, -MAX_ACCEL, MAX_ACCEL).astype(np.float32) if aided else None,
        covariance=covariance,
        zero_sequence=oriented.zero[0],
        zero=oriented.zero[1],
        quality=correction.quality,
        epoch=epoch,
    )


def _zero(attitude: Attitude) -> tuple[int, str]:
    return int(attitude.state[ZERO]), attitude.zero


def _first(attitude: Attitude, cut: Cut) -> int:
    """Index of the first sample of a cut that the attitude has not seen."""
    return max(cut.first, min(cut.end, int(attitude.state[NEXT]) - cut.samples.sequence))
