"""Runs of finite readings: NaN and infinity are cut out before any computation."""

import numpy as np

from bridge.wire.messages import SampleBatch


def runs(batch: SampleBatch, first: int) -> list[tuple[int, int]]:
    """Find the runs of consecutive samples whose gyro and accelerometer readings are all finite.

    first: index of the first sample to look at. Returns (begin, end) indices of each run, end exclusive, in order.
    A batch without NaN or infinity is a single run.
    """
    finite = np.isfinite(batch.gyro[first:]).all(axis=1)
    if batch.accel is not None:
        finite &= np.isfinite(batch.accel[first:]).all(axis=1)
    if finite.all():
        return [(first, len(batch))]
    edges = (np.flatnonzero(np.diff(finite, prepend=False, append=False)) + first).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))
