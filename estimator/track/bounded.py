"""Bounded motion: who breathes, sways or dozes turns to and fro, but not away.

Over a long stretch the mean of the true rate is the way from its first attitude to its last, over its time. How far the way
swings is seen in the stretch itself.
"""

from dataclasses import dataclass, replace
from math import radians

import numpy as np
from numpy.typing import NDArray

from estimator.gyro import mean_var, rounding_var
from estimator.track.bias_filter import BIAS, GATES, BiasFilter, Evidence, Receipt
from estimator.track.seconds import Second

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class BoundedKnobs:
    """What a bounded stretch is."""

    stretch_s: float = 30.0
    #: a body that swings farther is moving
    swing: float = radians(10.0)
    #: and one that seems to swing less does so where no reading shows it
    least_swing: float = radians(0.1)
    #: the last attitude of a stretch may be this many times the swing's deviation from its first
    ends: float = 2.0
    #: so many stretches in a row that contradict the bias are believed
    insist: int = 4


class Bounded:
    """Quiet seconds in, a receipt for each whole stretch out."""

    def __init__(self, knobs: BoundedKnobs | None = None) -> None:
        self.knobs = knobs or BoundedKnobs()
        self._refused = 0
        self._seconds: list[tuple[float, float, Floats, Floats, Floats]] = []  # start, end, mean, its variance, common

    def broken(self) -> None:
        """The stretch is over."""
        self._seconds.clear()

    def take(self, second: Second, bias: BiasFilter) -> Receipt | None:
        """Take the next second; a receipt when it completes a stretch."""
        variance, common = mean_var(second.std, second.step, len(second)), rounding_var(second.std, second.step)
        self._seconds.append((second.start, second.end, second.mean, variance, common))
        seconds = self._seconds[-1][1] - self._seconds[0][0]
        if seconds < self.knobs.stretch_s:
            return None
        starts, ends, means, variances, commons = (np.array(column) for column in zip(*self._seconds, strict=True))
        self._seconds.clear()
        lasted = (ends - starts)[:, None]
        z = (means * lasted).sum(axis=0) / seconds
        way = np.cumsum((means - z) * lasted, axis=0)
        swing = np.maximum(way.std(axis=0), self.knobs.least_swing)
        if np.any(np.abs(way) > self.knobs.swing):
            return None
        common = commons.max(axis=0)
        noise = ((variances - commons) * lasted**2).sum(axis=0) / seconds**2 + common
        R = np.diag((self.knobs.ends * swing / seconds) ** 2 + noise)
        H = np.zeros((3, len(bias.x)))
        H[:, BIAS] = np.eye(3)
        evidence = Evidence("bounded", z, H, R, GATES[3], common)
        receipt = bias.update(evidence)
        self._refused = 0 if receipt.accepted else self._refused + 1
        if self._refused < self.knobs.insist:
            return receipt
        self._refused = 0
        bias.widen(float(np.mean(receipt.innovation**2)) * np.eye(3))
        bias.update(evidence)
        return replace(receipt, accepted=True, reason="insisted")
