"""Poses of a device that is held and never laid down: where the hand was calm, gravity is averaged in a frame that turns along.

A hand's tremor tilts the device by degrees, which the gyro sees and takes out; what is left is the hand's acceleration, a
change of speed over the length of the pause: 0.1 m/s in 1.4 s is 0.4 degrees. The bias must be known from elsewhere, for a
hand is never still.
"""

from dataclasses import dataclass
from itertools import pairwise
from math import radians

import numpy as np

from estimator.calibration.capture import Floats, Movement, Rest, Samples
from estimator.geometry import rotation


@dataclass(frozen=True, slots=True)
class HandKnobs:
    """When a hand is calm."""

    #: rad/s, mean size of the rate over `smooth_s`
    calm: float = radians(25.0)
    smooth_s: float = 0.5
    #: seconds; a shorter pause shows the hand's acceleration more than gravity
    least_s: float = 0.8


def hand_held(samples: Samples, rest: Rest, knobs: HandKnobs | None = None) -> tuple[Movement, ...]:
    """The movements between calm poses; rest: of the same boot, for its bias and noise. Needs acceleration."""
    knobs = knobs or HandKnobs()
    if samples.accel is None:
        raise ValueError("poses held by hand need an accelerometer")
    poses = [_pose(samples, start, end, rest) for start, end in _calm(samples, rest.bias, knobs)]
    return tuple(Movement(a, b, samples.between(a.end, b.start)) for a, b in pairwise(poses))


def _calm(samples: Samples, bias: Floats, knobs: HandKnobs) -> list[tuple[int, int]]:
    size = np.linalg.norm(samples.gyro - bias, axis=1)
    half = max(round(knobs.smooth_s / float(np.median(np.diff(samples.time))) / 2), 1)
    padded = np.pad(size, half, mode="reflect")
    smooth = np.convolve(padded, np.full(2 * half + 1, 1 / (2 * half + 1)), mode="valid")
    edges = np.diff((smooth < knobs.calm).astype(int), prepend=0, append=0)
    runs = zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True)
    return [(int(a), int(b)) for a, b in runs if samples.time[b - 1] - samples.time[a] >= knobs.least_s]


def _pose(samples: Samples, start: int, end: int, rest: Rest) -> Rest:
    """As a rest at the middle of samples start to end: the mean acceleration in the attitude the device had there."""
    time, middle = samples.time[start:end], (end - start) // 2
    assert samples.accel is not None
    attitude = rotation.attitudes(samples.gyro[start:end] - rest.bias, rotation.intervals(time))[1:]
    mean = np.einsum("tij,tj->i", attitude, samples.accel[start:end]) / (end - start)
    at = float(time[middle])
    return Rest(at, at, rest.bias, rest.std, rest.step, rest.n, attitude[middle].T @ mean)
