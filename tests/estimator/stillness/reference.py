"""Stillness in plain Python and NumPy, one window after the other: slow, and the witness of the compiled loop."""

from bisect import bisect_left
from collections import deque
from collections.abc import Iterator
from itertools import pairwise
from math import fsum, sqrt
from statistics import median

import numpy as np
from numpy.typing import NDArray

from estimator.stillness import detector as limits
from estimator.stillness.detector import Window

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Three = list[float]


class ReferenceStillness:
    """As estimator.stillness.detector.Stillness."""

    def __init__(self) -> None:
        self.noise_known = False
        self.noise_std: Floats = np.full(3, limits.NOISE_GUESS)
        self._noise_hz = 0.0  # the rate of the samples that showed it; 0 until then
        self._reference: Three | None = None
        self._anchor: Three | None = None  # the reference when this rest began
        self._last: tuple[float, Floats] | None = None  # time and reading
        self._rest: deque[tuple[Three, Three, float]] = deque(maxlen=16)  # mean, standard deviation, rate
        self._odd: list[tuple[float, Three]] = []  # start and mean
        self._count = 0
        self._time, self._read, self._clipped = np.empty(0), np.empty((0, 6)), np.empty(0, bool)

    def feed(self, time: Floats, gyro: Floats, accel: Floats | None, clipped: Flags) -> Iterator[Window]:
        """Take samples, yield the windows that they close."""
        read = np.hstack([gyro, np.full_like(gyro, np.nan) if accel is None else accel])
        self._time, self._read = np.concatenate([self._time, time]), np.concatenate([self._read, read])
        self._clipped = np.concatenate([self._clipped, clipped])
        while n := self._cut():
            taken = self._time[:n], self._read[:n], self._clipped[:n]
            self._time, self._read, self._clipped = self._time[n:], self._read[n:], self._clipped[n:]
            yield self._close(*taken)

    def _cut(self) -> int:
        """How many of the samples that are held make the next window; 0 when there are too few."""
        time = self._time.tolist()
        if len(time) < limits.MIN_SAMPLES or time[-1] - time[0] < limits.WINDOW_S:
            return 0
        n = max(limits.MIN_SAMPLES, bisect_left(time, time[0] + limits.WINDOW_S) + 1)
        most = n + 2
        while (
            n <= len(time) and n < most and np.abs(self._read[n - 1] - self._read[n - 2])[:3].max() > limits.SPIKE_FAR
        ):
            n += 1
        return n if n <= len(time) else 0

    def _close(self, time: Floats, read: Floats, clipped: Flags) -> Window:
        n = len(time)
        start, self._count = self._count, self._count + n
        begun, ended = float(time[0]), float(time[-1])
        last_time, last_gyro = self._last or (begun, read[0, :3])
        mean, std, spikes = read.mean(axis=0), read.std(axis=0, ddof=1), 0
        if std[:3].max() * sqrt(2 * (n - 1)) > limits.SPIKE_FAR:
            before = last_gyro if begun - last_time < limits.GAP_S else read[0, :3]
            gyro, spiked = mended(before, read[:, :3])
            read, clipped, spikes = np.hstack([gyro, read[:, 3:]]), clipped & ~spiked, int(spiked.sum())
            mean, std = read.mean(axis=0), read.std(axis=0, ddof=1)
        self._last = ended, read[-1, :3]
        gap = any(b - a >= limits.GAP_S for a, b in pairwise([last_time, *time.tolist()]))
        if gap:
            self._odd.clear()
        aided = not np.isnan(mean[3])
        rate_hz = (n - 1) / (ended - begun)
        denser = sqrt(rate_hz / self._noise_hz) if self._noise_hz and rate_hz > 1.5 * self._noise_hz else 1.0
        still = not (gap or clipped.any()) and self._judge(
            begun, ended, mean[:3].tolist(), std[:3], denser, std[3:].tolist() if aided else None
        )
        self._learn(mean[:3].tolist(), std[:3].tolist(), rate_hz, still=still)
        rows, summed = np.column_stack([time, read, clipped]), np.concatenate([mean, std])
        return Window(start, self._count, begun, ended, rows, summed, spikes, still, bool(aided))

    def _judge(
        self, begun: float, ended: float, mean: Three, std: Floats, denser: float, accel_std: Three | None
    ) -> bool:
        most = np.clip(limits.NOISE_FACTOR * denser * self.noise_std, limits.STD_FLOOR, limits.STD_CEILING)
        calm = accel_std is None or max(accel_std) <= limits.ACCEL_STD
        if not calm or (std > most).any():
            self._odd.clear()
            return False
        if self._reference is None or self._near(mean, self._reference):
            if self._anchor is None or self._near(mean, self._anchor):
                self._odd.clear()
                return True
            self._reference = self._anchor
        return self._adopt_odd(begun, ended, mean)

    def _near(self, mean: Three, reference: Three) -> bool:
        return all(abs(a - b) < limits.MEAN_TOLERANCE for a, b in zip(mean, reference, strict=True))

    def _adopt_odd(self, begun: float, ended: float, mean: Three) -> bool:
        if self._odd and not self._near(mean, self._odd[0][1]):
            self._odd.clear()
        self._odd.append((begun, mean))
        if ended - self._odd[0][0] < limits.NEW_REFERENCE_S:
            return False
        self._reference, self._anchor = mean, None
        self._odd.clear()
        return True

    def _learn(self, mean: Three, std: Three, rate_hz: float, *, still: bool) -> None:
        if not still:
            self._rest.clear()
            self._anchor = None
            return
        self._rest.append((mean, std, rate_hz))
        n = len(self._rest)
        if self._reference is None and n < 4:
            return
        means, stds, rates = zip(*self._rest, strict=True)
        self._reference = [fsum(axis) / n for axis in zip(*means, strict=True)]
        if self._anchor is None and n >= 4:
            self._anchor = self._reference
        if n >= 8:
            self.noise_std = np.array([median(axis) for axis in zip(*stds, strict=True)])
            self.noise_known = True
            self._noise_hz = sorted(rates)[n // 2]


def mended(before: Floats, gyro: Floats) -> tuple[Floats, Flags]:
    """The readings (n, 3) without lone spikes, and which were (n,); before (3,): the reading ahead of them."""
    around = np.concatenate([before[None], gyro])
    between = 0.5 * (around[:-2] + around[2:])
    off = np.abs(around[1:-1] - between)
    agreed = off > np.abs(around[2:] - around[:-2])
    beside = np.pad(off, ((1, 1), (0, 0)))
    alone = off > limits.SPIKE_ALONE * np.maximum(beside[:-2], beside[2:])
    lone = agreed & alone & (off > np.maximum(limits.SPIKE_FAR, limits.SPIKE_FACTOR * np.median(off, axis=0)))
    return np.concatenate([np.where(lone, between, gyro[:-1]), gyro[-1:]]), np.append(lone.any(axis=1), False)
