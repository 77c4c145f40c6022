"""Window summaries: statistics of samples over 0.1 s of device time, for views of many devices. Pure.

The mean over a window is a moving average, which keeps fast motion from appearing as slow motion (aliasing).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.wire.batches import TOLD
from bridge.wire.messages import WindowBatch
from estimator.device.correction import Correction
from estimator.geometry.gyro_model import Floats, corrected
from estimator.samples.blocks import BLOCK_S
from estimator.samples.sample_buffer import FLAGS, GYRO, HOST_NS, SEQUENCE, TIME

Wholes = NDArray[np.int64]

WINDOWS_HZ = 10
#: windows in one block, which one message covers
_WINDOWS = round(BLOCK_S * WINDOWS_HZ)


class Second(NamedTuple):
    """Samples of a finished block of a device (half a second or a second), and the correction applied to them.

    rows (n, 9): device time (s), gyro (3, rad/s), accel (3, m/s²), clipped or stuck (0 or 1), temperature (°C).
    places (n, 3): sequence number, host time (ns since the Unix epoch), flags.
    """

    device: str
    boot: int
    rows: Floats
    places: Wholes
    applied: Correction


def windows(seconds: Sequence[Second]) -> list[WindowBatch]:
    """Compute window summaries of blocks of samples over 0.1 s of device time; one message for each block.

    Each window has the mean, standard deviation, minimum and maximum of readings and of corrected rates, all rad/s by
    axis. The blocks may be of one device or of many.
    """
    lengths = np.array([len(second.rows) for second in seconds])
    of_second = np.repeat(np.arange(len(seconds)), lengths)
    rows, places = (np.concatenate([getattr(second, name) for second in seconds]) for name in ("rows", "places"))
    begin_s = np.array([second.rows[0, TIME] // BLOCK_S * BLOCK_S for second in seconds])
    within = ((rows[:, TIME] - begin_s[of_second]) * WINDOWS_HZ).astype(np.int64).clip(0, _WINDOWS - 1)
    begins = np.append(
        0, ((of_second * _WINDOWS + within)[1:] != (of_second * _WINDOWS + within)[:-1]).nonzero()[0] + 1
    )
    samples = np.append(begins[1:], len(rows)) - begins
    ends = begins + samples - 1
    columns = np.concatenate([_spread(values, begins, samples) for values in _values(seconds, rows, lengths)])
    sequences, times_ns = places[ends, SEQUENCE].astype(np.uint64), places[ends, HOST_NS]
    flags = np.bitwise_or.reduceat(places[:, FLAGS], begins).astype(np.uint32)
    numbers = samples.astype(np.uint32)
    cuts = np.searchsorted(of_second[ends], np.arange(len(seconds) + 1)).tolist()
    found = []
    for second, a, b in zip(seconds, cuts, cuts[1:], strict=False):
        found.append(
            WindowBatch(
                second.device,
                second.boot,
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
                quality=second.applied.quality,
                calibration=second.applied.calibration,
                **dict(zip(TOLD, second.applied.told, strict=True)),
            )
        )
    return found


def _spread(values: Floats, begins: Wholes, n: Wholes) -> NDArray[np.float32]:
    """(4, m, 3) mean, standard deviation, least and most of windows.

    values (…, 3): samples; begins (m,): index of each window's first; n (m,): its number of samples.
    """
    mean = np.add.reduceat(values, begins) / n[:, None]
    off = values - mean.repeat(n, axis=0)
    std = np.sqrt(np.add.reduceat(off * off, begins) / n[:, None])
    found = [mean, std, np.minimum.reduceat(values, begins), np.maximum.reduceat(values, begins)]
    return np.array(found, np.float32)


def _values(seconds: Sequence[Second], rows: Floats, lengths: Wholes) -> tuple[Floats, Floats]:
    """Readings (n, 3), and their corrected rates (n, 3) as published."""
    reading = rows[:, GYRO]
    matrix = np.array([second.applied.model.matrix for second in seconds]).repeat(lengths, axis=0)
    bias = np.array([second.applied.model.bias for second in seconds]).repeat(lengths, axis=0)
    return reading, corrected(reading, matrix, bias)
