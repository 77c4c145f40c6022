"""Correction of gyro readings: applies matrix and bias to samples of any number of devices in one call."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bridge.wire.batches import MAX_CORRECTED, TOLD
from bridge.wire.messages import CorrectedBatch, SampleFlag
from estimator.device.correction import Correction
from estimator.kernels.samples import corrected
from estimator.samples.sample_buffer import HOST_NS, Samples


class Cut(NamedTuple):
    """Segment of a sample message, and the correction that applies to this segment.

    The segment has the samples from index `first` up to but not including index `end`.
    """

    samples: Samples
    correction: Correction
    first: int
    end: int

    @property
    def n(self) -> int:
        """Number of samples in the segment."""
        return self.end - self.first

    @property
    def header(self) -> tuple[int, int, int, float, float, bytes]:
        """Header of the segment, as the encoders of the wire format expect it: a tuple of six values.

        Boot id; sequence number of the first sample; host time of the first sample, ns since the Unix epoch; length of
        a device clock tick, s; host seconds per second of the device's clock; ticks of all samples, packed as uint64.
        """
        samples, _, first, end = self
        place = samples.boot, samples.sequence + first, samples.places.item(first, HOST_NS)
        return *place, samples.tick_period_s, samples.clock_rate, samples.ticks[8 * first : 8 * end]


#: corrected rates (n, 3) float32 and flags (n,) uint32, packed as on the wire; flags are empty when none is set
Rates = tuple[bytes, bytes]


def correct(cuts: Sequence[Cut]) -> list[Rates]:
    """Compute the corrected rates of each segment: rate = matrix (reading − bias).

    Result, in the order of `cuts`: rates in rad/s (n, 3) as packed float32, and flags (n,) as packed uint32, empty
    where no flag is set. A rate beyond the range of the wire format is limited to this range and flagged as clipped.

    The result of a segment is bit for bit the same whichever segments are corrected in the same call.
    """
    if not cuts:
        return []
    parts = [samples.rows if end - first == samples.n else samples.rows[first:end] for samples, _, first, end in cuts]
    rows = np.concatenate(parts)
    parameters = np.concatenate([correction.parameters for _, correction, _, _ in cuts]).reshape(-1, 12)
    counts = [end - first for _, _, first, end in cuts]
    rate, beyond = np.empty((len(rows), 3), np.float32), np.empty(len(rows), np.bool_)
    clips = corrected(rows, np.array(counts), parameters, MAX_CORRECTED, rate, beyond)
    packed, found, at = rate.tobytes(), list[Rates](), 0
    for cut, n in zip(cuts, counts, strict=True):
        flags = cut.samples.flags[4 * cut.first : 4 * cut.end]
        if clips and beyond[at : at + n].any():
            known = np.frombuffer(flags or bytes(4 * n), np.uint32)
            flags = np.where(beyond[at : at + n], known | np.uint32(SampleFlag.CLIPPED), known).tobytes()
        found.append((packed[12 * at : 12 * (at + n)], flags))
        at += n
    return found


def batch_of(cut: Cut, rates: Rates) -> CorrectedBatch:
    """Build the CorrectedBatch message of one segment.

    rates: the segment's element of the result of `correct`: packed rates (n, 3), rad/s, and flags.
    """
    boot, sequence, start_time_ns, tick_period_s, clock_rate, ticks = cut.header
    correction, (rate, flags) = cut.correction, rates
    return CorrectedBatch(
        device=cut.samples.device,
        boot=boot,
        sequence=sequence,
        start_time_ns=start_time_ns,
        tick_period_s=tick_period_s,
        clock_rate=clock_rate,
        ticks=np.frombuffer(ticks, np.uint64),
        rate=np.frombuffer(rate, np.float32).reshape(-1, 3),
        flags=np.frombuffer(flags or bytes(4 * cut.n), np.uint32),
        quality=correction.quality,
        **dict(zip(TOLD, correction.told, strict=True)),
        calibration=correction.calibration,
    )
