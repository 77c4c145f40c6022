"""What samples were like, tenth by tenth of a second of device time: for who looks at many devices. Pure.

The mean over a window is the moving average that keeps what is faster than the windows from showing as something slow.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.wire.messages import WindowBatch
from estimator.block import BLOCK_S, Run, sample_time_ns
from estimator.correction import Correction
from estimator.gyro import corrected

Floats = NDArray[np.float64]
Wholes = NDArray[np.int64]

WINDOWS_HZ = 10
#: of a block, which one message tells of
_WINDOWS = round(BLOCK_S * WINDOWS_HZ)


class Second(NamedTuple):
    """Samples of a block that is over, and how they were corrected."""

    run: Run
    applied: Correction


def windows(seconds: Sequence[Second]) -> list[WindowBatch]:
    """A message of each second, of one device or of many: all of them in one go."""
    lengths = np.array([len(second.run.rows) for second in seconds])
    of_second = np.repeat(np.arange(len(seconds)), lengths)
    time = np.concatenate([second.run.time for second in seconds])
    begin_s = np.array([second.run.time[0] // BLOCK_S * BLOCK_S for second in seconds])
    within = ((time - begin_s[of_second]) * WINDOWS_HZ).astype(np.int64).clip(0, _WINDOWS - 1)
    begins = np.append(
        0, ((of_second * _WINDOWS + within)[1:] != (of_second * _WINDOWS + within)[:-1]).nonzero()[0] + 1
    )
    samples = np.append(begins[1:], len(time)) - begins
    ends = begins + samples - 1
    columns = np.concatenate([_spread(values, begins, samples) for values in _values(seconds, lengths)])
    sequences = np.concatenate([second.run.sequences for second in seconds])[ends].astype(np.uint64)
    flags = np.bitwise_or.reduceat(np.concatenate([second.run.flags for second in seconds]), begins)
    times_ns, numbers = _times_ns(seconds, time[ends], of_second[ends]), samples.astype(np.uint32)
    cuts = np.searchsorted(of_second[ends], np.arange(len(seconds) + 1)).tolist()
    found = []
    for second, a, b in zip(seconds, cuts, cuts[1:], strict=False):
        run, applied = second
        found.append(
            WindowBatch(
                run.last[0].device,
                run.boot,
                1 / WINDOWS_HZ,
                sequences[a:b],
                times_ns[a:b],
                numbers[a:b],
                flags[a:b],
                columns[0, a:b],
                columns[1, a:b],
                columns[2, a:b],
                columns[3, a:b],
                columns[4, a:b],
                columns[5, a:b],
                columns[6, a:b],
                columns[7, a:b],
                quality=applied.quality,
                calibration=applied.calibration,
                **applied.told._asdict(),
            )
        )
    return found


def _spread(values: Floats, begins: Wholes, n: Wholes) -> NDArray[np.float32]:
    """(4, m, 3) mean, deviation from it, least and most of windows of n (m,) values (…, 3) that begin there."""
    mean = np.add.reduceat(values, begins) / n[:, None]
    off = values - mean.repeat(n, axis=0)
    std = np.sqrt(np.add.reduceat(off * off, begins) / n[:, None])
    found = [mean, std, np.minimum.reduceat(values, begins), np.maximum.reduceat(values, begins)]
    return np.array(found, np.float32)


def _values(seconds: Sequence[Second], lengths: Wholes) -> tuple[Floats, Floats]:
    """Readings (n, 3), and their corrected rates (n, 3) as they are published."""
    reading = np.concatenate([second.run.gyro for second in seconds])
    matrix = np.array([second.applied.model.matrix for second in seconds]).repeat(lengths, axis=0)
    bias = np.array([second.applied.model.bias for second in seconds]).repeat(lengths, axis=0)
    return reading, corrected(reading, matrix, bias)


def _times_ns(seconds: Sequence[Second], time: Floats, of_second: Wholes) -> Wholes:
    """Host time of samples taken at this device time, each by its second's last batch."""
    lasts = [second.run.last for second in seconds]
    end_ns = np.array([sample_time_ns(*last) for last in lasts])
    end_s = np.array([second.run.time[-1] for second in seconds])
    rate = np.array([batch.clock_rate for batch, _ in lasts]) * 1e9
    since = np.rint((time - end_s[of_second]) * rate[of_second]).astype(np.int64)
    return np.asarray(end_ns[of_second] + since, np.int64)
