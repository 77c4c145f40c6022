"""Mean corrected rates (rad/s) at a lower sample rate.

A mean rate multiplied by its interval (s) is the rotation (rad) during the averaged samples.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from math import sqrt

import numpy as np

from bridge.wire.messages import CorrectedBatch, Floats

#: part of an interval by which floating point may place a sample wrongly
_ROUNDING = 1e-6


@dataclass(slots=True)
class _Interval:
    number: int  # of the interval, in device time
    latest: CorrectedBatch  # the last sample of it, alone
    total: Floats
    flags: int
    samples: int


class MeanRates:
    """Averager of one device's corrected rates over intervals of 1/hz seconds of device time.

    hz: rate of the means, Hz.
    A mean is a batch of one sample, with the sequence number and times of the last sample of its interval. It has the
    mean rate (rad/s), all flags of the samples, and noise_std (rad/s) of the mean. The other standard deviations stay
    unchanged, because averaging does not reduce them.

    The intervals end at multiples of 1/hz of the device's clock, so the means do not depend on batches or on where a
    stream resumes. A sample covers the time before its tick: at the end of an interval it belongs to that interval.
    """

    def __init__(self, hz: float) -> None:
        self._hz = hz
        self._interval: _Interval | None = None

    def add(self, batch: CorrectedBatch) -> list[CorrectedBatch]:
        """Add samples, in order; return the mean of each interval that they complete, as batches of one sample."""
        numbers = np.ceil(batch.device_time * self._hz - _ROUNDING).astype(np.int64)
        cuts = [0, *(np.flatnonzero(np.diff(numbers)) + 1).tolist(), len(batch)]
        ended: list[CorrectedBatch] = []
        for start, end in pairwise(cuts):
            open_ = self._interval
            if open_ is not None and (open_.number, open_.latest.boot) != (numbers[start], batch.boot):
                ended += self.flush()
            if self._interval is None:
                self._interval = _Interval(int(numbers[start]), batch, np.zeros(3), 0, 0)
            now = self._interval
            now.latest = replace(
                batch.after(end - 1), ticks=batch.ticks[end - 1 : end], flags=batch.flags[end - 1 : end]
            )
            now.total += batch.rate[start:end].sum(axis=0, dtype=np.float64)
            now.flags |= int(np.bitwise_or.reduce(batch.flags[start:end]))
            now.samples += end - start
        return ended

    def flush(self) -> list[CorrectedBatch]:
        """End the unfinished interval; return its mean as a list of one batch, or an empty list without samples."""
        ended, self._interval = self._interval, None
        if ended is None:
            return []
        rate = (ended.total / ended.samples).astype(np.float32)[None]
        noise_std = (ended.latest.noise_std / sqrt(ended.samples)).astype(np.float32)
        flags = np.array([ended.flags], np.uint32)
        return [replace(ended.latest, rate=rate, flags=flags, noise_std=noise_std)]
