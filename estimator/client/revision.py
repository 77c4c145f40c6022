"""Application of a bias revision to past corrected batches (docs/wire.md)."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bridge.wire.messages import BiasRevision, CorrectedBatch

Floats = NDArray[np.float64]

#: clock fits agree on a sample's time within this span; a device restarted under its old boot number is later
SAME_TIME_NS = 1_000_000_000


def revised(batch: CorrectedBatch, revision: BiasRevision) -> CorrectedBatch:
    """Return a batch with its rates recomputed from the revised bias, for the samples that the revision covers.

    Other samples stay unchanged; a batch without covered samples is returned unchanged.
    Method: rate + matrix (published bias − revised bias), in rad/s, sensor frame. The revised bias is interpolated
    linearly between the points of the revision.
    The result's `bias` (3,) is the mean bias of its samples, its `bias_std` (3,) the largest standard deviation, rad/s.
    """
    covered = covers(revision, batch)
    if not covered.any():
        return batch
    since_ns = batch.sample_time_ns[covered] - revision.times_ns[0]
    bias, reading_std = np.tile(batch.bias.astype(float), (len(batch), 1)), _at(since_ns, revision, revision.bias_std)
    bias[covered] = _at(since_ns, revision, revision.bias)
    bias_std = np.sqrt(reading_std**2 @ revision.matrix.T**2).max(axis=0)
    return replace(
        batch,
        rate=(batch.rate + (batch.bias - bias) @ revision.matrix.T).astype(np.float32),
        bias=bias.mean(axis=0).astype(np.float32),
        bias_std=(bias_std if covered.all() else np.maximum(bias_std, batch.bias_std)).astype(np.float32),
    )


def covers(revision: BiasRevision, batch: CorrectedBatch) -> NDArray[np.bool_]:
    """Return a mask (n,), True for each sample of a batch that a revision covers.

    Device, boot and calibration must be equal. The sample's number must be from that of the revision's first point to
    that of its last. The same holds for the host time, with a tolerance of SAME_TIME_NS (1 s) at both ends.
    """
    if (batch.device, batch.boot, batch.calibration) != (revision.device, revision.boot, revision.calibration):
        return np.zeros(len(batch), np.bool_)
    number, time_ns = np.uint64(batch.sequence) + np.arange(len(batch), dtype=np.uint64), batch.sample_time_ns
    first_ns, last_ns = revision.times_ns[0] - SAME_TIME_NS, revision.times_ns[-1] + SAME_TIME_NS
    return np.asarray(
        (revision.sequences[0] <= number)
        & (number <= revision.sequences[-1])
        & (first_ns <= time_ns)
        & (time_ns <= last_ns)
    )


def _at(since_ns: NDArray[np.int64], revision: BiasRevision, values: NDArray[np.float32]) -> Floats:
    """(n, 3) values interpolated linearly between the revision's points; constant beyond the first and last point."""
    points_ns = revision.times_ns - revision.times_ns[0]
    return np.column_stack([np.interp(since_ns, points_ns, values[:, axis]) for axis in range(3)])
