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
#: so many blocks are told in one message
BLOCKS = 2
_SPAN_S, _WINDOWS = BLOCKS * BLOCK_S, round(BLOCKS * BLOCK_S * WINDOWS_HZ)


class Half(NamedTuple):
    """Samples of one block, which is the number-th, and how the last of them was corrected."""

    number: int
    run: Run
    applied: Correction


#: what is told in one message
Second = Sequence[Half]


class Windowed:
    """Blocks of one device in, seconds out."""

    def __init__(self) -> None:
        self._held: list[Half] = []

    def add(self, run: Run, applied: Correction) -> list[Second]:
        """Take samples of a block that is over, as they were corrected; the seconds that are whole now."""
        half = Half(int(run.time[0] // BLOCK_S), run, applied)
        found: list[Second] = []
        if self._held and not _together(self._held[-1], half):
            found.append(self._held)
            self._held = []
        self._held.append(half)
        if half.number % BLOCKS == BLOCKS - 1:
            found.append(self._held)
            self._held = []
        return found


def _together(before: Half, after: Half) -> bool:
    """Whether two halves may share a message: one boot, one second, one calibration."""
    a, b = before.applied, after.applied
    same = (a.quality, a.calibration) == (b.quality, b.calibration) and before.run.boot == after.run.boot
    return same and before.number // BLOCKS == after.number // BLOCKS


def windows(seconds: Sequence[Second]) -> list[WindowBatch]:
    """A message of each second, of one device or of many: all of them in one go."""
    halves = [half for second in seconds for half in second]
    lengths = np.array([len(half.run.rows) for half in halves])
    of_second = np.repeat(np.arange(len(seconds)), [sum(len(half.run.rows) for half in second) for second in seconds])
    time = np.concatenate([half.run.time for half in halves])
    begin_s = np.array([second[0].number // BLOCKS * _SPAN_S for second in seconds])
    within = ((time - begin_s[of_second]) * WINDOWS_HZ).astype(np.int64).clip(0, _WINDOWS - 1)
    begins = np.append(
        0, ((of_second * _WINDOWS + within)[1:] != (of_second * _WINDOWS + within)[:-1]).nonzero()[0] + 1
    )
    samples = np.append(begins[1:], len(time)) - begins
    ends = begins + samples - 1
    columns = np.concatenate([_spread(values, begins, samples) for values in _values(halves, lengths)])
    sequences = np.concatenate([half.run.sequences for half in halves])[ends].astype(np.uint64)
    flags = np.bitwise_or.reduceat(np.concatenate([half.run.flags for half in halves]), begins)
    times_ns, numbers = _times_ns(seconds, time[ends], of_second[ends]), samples.astype(np.uint32)
    cuts = np.searchsorted(of_second[ends], np.arange(len(seconds) + 1)).tolist()
    found = []
    for second, a, b in zip(seconds, cuts, cuts[1:], strict=False):
        run, applied = second[-1].run, second[-1].applied
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


def _values(halves: Sequence[Half], lengths: Wholes) -> tuple[Floats, Floats]:
    """Readings (n, 3), and their corrected rates (n, 3) as they are published."""
    reading = np.concatenate([half.run.gyro for half in halves])
    matrix = np.array([half.applied.model.matrix for half in halves]).repeat(lengths, axis=0)
    bias = np.array([half.applied.model.bias for half in halves]).repeat(lengths, axis=0)
    return reading, corrected(reading, matrix, bias)


def _times_ns(seconds: Sequence[Second], time: Floats, of_second: Wholes) -> Wholes:
    """Host time of samples taken at this device time, each by its second's last batch."""
    lasts = [second[-1].run.last for second in seconds]
    end_ns = np.array([sample_time_ns(*last) for last in lasts])
    end_s = np.array([second[-1].run.time[-1] for second in seconds])
    rate = np.array([batch.clock_rate for batch, _ in lasts]) * 1e9
    since = np.rint((time - end_s[of_second]) * rate[of_second]).astype(np.int64)
    return np.asarray(end_ns[of_second] + since, np.int64)
