"""Spikes: a reading alone far from both its neighbours is no movement of anything; it is replaced by their mean."""

from dataclasses import dataclass
from math import radians

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SpikeKnobs:
    """When a reading is a spike."""

    #: rad/s from the mean of its neighbours, which a tap does not reach, and so many times farther than is usual around it
    far: float = radians(200.0)
    factor: float = 10.0
    #: and than those beside it
    alone: float = 1.5


def mended(before: Floats, gyro: Floats, knobs: SpikeKnobs) -> tuple[Floats, NDArray[np.bool_] | None]:
    """The readings (n, 3) without lone spikes, and which were (n,); before (3,): the reading ahead of them.

    The last has one neighbour only, and is never taken for a spike. Two alike in a row are none: something moved.
    """
    leap = np.abs(np.diff(gyro, axis=0, prepend=before[None]))
    if leap.max() <= knobs.far:
        return gyro, None
    around = np.concatenate([before[None], gyro])
    between = 0.5 * (around[:-2] + around[2:])
    off = np.abs(around[1:-1] - between)
    # Of a step, or of two alike, the neighbours differ by twice as much.
    agreed = off > np.abs(around[2:] - around[:-2])
    # A spike also spoils its neighbours' means, by half of itself.
    beside = np.pad(off, ((1, 1), (0, 0)))
    alone = off > knobs.alone * np.maximum(beside[:-2], beside[2:])
    lone = agreed & alone & (off > np.maximum(knobs.far, knobs.factor * np.median(off, axis=0)))
    if not lone.any():
        return gyro, None
    return np.concatenate([np.where(lone, between, gyro[:-1]), gyro[-1:]]), np.append(lone.any(axis=1), False)
