"""Still or moving: the stream cut into short windows, each judged against the device's own noise and its own rest.

Limits follow the device: a large turn-on bias is no movement, so rates are compared with the mean of the last rest,
never with zero.
"""

from bisect import bisect_left
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from math import fsum, radians, sqrt

import numpy as np
from numpy.typing import NDArray

from estimator.gyro import spread, spreads
from estimator.held import Held
from estimator.spikes import SpikeKnobs, mended

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Three = list[float]
#: mean (3), standard deviation (3) and rate of a window
_Quiet = tuple[float, ...]
#: windows of a rest that tell of its noise
_RECENT = 16
#: a window is made longer by so many samples at most, so as not to end at a spike
_SPIKE_AND_BACK = 2
#: times the rate at which noise was learnt: beyond, the device was told to send faster
_FASTER = 1.5


@dataclass(frozen=True, slots=True)
class StillnessKnobs:
    """What counts as still. Rates in rad/s, accelerations in m/s²."""

    window_s: float = 0.125
    min_samples: int = 6
    #: assumed white noise of one reading until a rest has shown it
    noise_guess: float = radians(0.15)
    #: a window is still when its standard deviation stays below this many times the noise ...
    noise_factor: float = 5.0
    #: ... or below this, so that a very quiet device is not disturbed by a footfall
    std_floor: float = radians(0.2)
    accel_std: float = 0.3
    #: how far the mean of a still window may be from the mean of the last rest
    mean_tolerance: float = radians(1.5)
    #: a constant rate that lasts this long is a new rest: no hand turns so evenly
    new_reference_s: float = 20.0
    #: whatever the noise that was learnt, more than this is movement: a tremor must not teach itself to be rest
    std_ceiling: float = radians(1.5)
    #: a silence this long hides what happened in it: no stillness spans it
    gap_s: float = 0.25
    spike: SpikeKnobs = field(default_factory=SpikeKnobs)


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """A short run of n samples, spikes mended: time (n,), gyro (n, 3), accel (n, 3) or None, clipped (n,).

    `end` counts samples since the first one fed; mean and std (3,) of its readings; spikes: how many were mended.
    """

    start: int
    end: int
    start_time: float
    end_time: float
    time: Floats
    gyro: Floats
    accel: Floats | None
    clipped: Flags
    mean: Floats
    std: Floats
    accel_mean: Floats | None
    accel_std: Floats | None
    spikes: int
    still: bool

    @property
    def samples(self) -> int:
        """How many samples it has."""
        return self.end - self.start

    @property
    def rate_hz(self) -> float:
        """Samples a second."""
        return (self.samples - 1) / (self.end_time - self.start_time)


class Stillness:
    """Samples in, judged windows out; the cut depends on the samples alone, never on how they were batched."""

    def __init__(self, knobs: StillnessKnobs | None = None) -> None:
        self.knobs = knobs or StillnessKnobs()
        self.noise_known = False
        self._noise_hz = 0.0  # the rate of the samples that showed it; 0 until then
        self._learnt(np.full(3, self.knobs.noise_guess))
        self._reference: Three | None = None
        self._anchor: Three | None = None  # the reference when this rest began: a slow turn must not drag it along
        self._last: tuple[float, Floats] | None = None  # time and reading
        self._rest: deque[_Quiet] = deque(maxlen=_RECENT)  # the latest windows of a rest
        self._odd: list[tuple[float, Three]] = []  # start and mean
        self._count = 0
        self._held = Held()

    def feed(self, time: Floats, gyro: Floats, accel: Floats | None, clipped: Flags | None = None) -> Iterator[Window]:
        """Take samples (n,), (n, 3), (n, 3), (n,) and yield each window as it closes; consume it all before feeding again."""
        self._held.put(time, gyro, accel, clipped)
        lengths = list(self._cuts())
        if not lengths:
            return
        times, read, clipping = self._held.draw(sum(lengths))
        begin = 0
        for n, mean, std in zip(lengths, *spreads(read, lengths), strict=True):
            here = slice(begin, begin + n)
            begin += n
            yield self._close(times[here], read[here], clipping[here], mean, std)

    def _cuts(self) -> Iterator[int]:
        """How many of the samples that are held make a window, those of the next one, and so on."""
        held, knobs = self._held, self.knobs
        time = held.time.tolist()
        start, end = 0, len(time)
        while end - start >= knobs.min_samples and time[-1] - time[start] >= knobs.window_s:
            n = max(knobs.min_samples, bisect_left(time, time[start] + knobs.window_s, start) - start + 1)
            # A window does not end at a spike: what follows it tells that it is one.
            most = n + _SPIKE_AND_BACK
            while start + n <= end and n < most and held.leap(start + n - 1) > knobs.spike.far:
                n += 1
            if start + n > end:
                return
            yield n
            start += n

    def _close(self, time: Floats, read: Floats, clipped: Flags, mean: Floats, std: Floats) -> Window:
        """Judge a window: time (n,), gyro and accel side by side (n, 6), clipped (n,); mean and std (6,)."""
        n = len(time)
        start, self._count = self._count, self._count + n
        begun, ended = float(time[0]), float(time[-1])
        last_time, last_gyro = self._last or (begun, read[0, :3])
        means, stds, spikes = mean.tolist(), std.tolist(), 0
        if max(stds[:3]) * sqrt(2 * (n - 1)) > self.knobs.spike.far:  # else nothing leaps so far
            gyro, spiked = mended(
                last_gyro if begun - last_time < self.knobs.gap_s else read[0, :3], read[:, :3], self.knobs.spike
            )
            if spiked is not None:
                # One that was mended is no longer clipped.
                read, clipped, spikes = np.hstack([gyro, read[:, 3:]]), clipped & ~spiked, int(spiked.sum())
                mean, std = spread(read)
                means, stds = mean.tolist(), std.tolist()
        self._last = ended, read[-1, :3]
        gap = ended - last_time >= self.knobs.gap_s and np.diff(time, prepend=last_time).max() >= self.knobs.gap_s
        if gap:
            self._odd.clear()
        aided = means[3] == means[3]  # a window with an accelerometer in a part of it only is judged without
        rate_hz = (n - 1) / (ended - begun) if ended > begun else 0.0
        # A device that is told to send faster averages over less: a reading's noise grows until it is learnt anew.
        denser = sqrt(rate_hz / self._noise_hz) if self._noise_hz and rate_hz > _FASTER * self._noise_hz else 1.0
        limits = self._limits if denser == 1.0 else self._limits_at(denser)
        still = not (gap or clipped.any()) and self._judge(
            begun, ended, means[:3], stds[:3], limits, stds[3:] if aided else None
        )
        self._learn((*means[:3], *stds[:3], rate_hz), still=still)
        return Window(
            start,
            self._count,
            begun,
            ended,
            time,
            read[:, :3],
            read[:, 3:] if aided else None,
            clipped,
            mean[:3],
            std[:3],
            mean[3:] if aided else None,
            std[3:] if aided else None,
            spikes,
            still,
        )

    def _judge(
        self, begun: float, ended: float, mean: Three, std: Three, limits: Three, accel_std: Three | None
    ) -> bool:
        calm = accel_std is None or max(accel_std) <= self.knobs.accel_std
        (x, y, z), (a, b, c) = std, limits
        if not calm or x > a or y > b or z > c:
            self._odd.clear()
            return False
        if self._reference is None or self._near(mean, self._reference):
            if self._anchor is None or self._near(mean, self._anchor):
                self._odd.clear()
                return True
            self._reference = self._anchor
        return self._adopt_odd(begun, ended, mean)

    def _near(self, mean: Three, reference: Three) -> bool:
        (x, y, z), (a, b, c), far = mean, reference, self.knobs.mean_tolerance
        return abs(x - a) < far and abs(y - b) < far and abs(z - c) < far

    def _adopt_odd(self, begun: float, ended: float, mean: Three) -> bool:
        # Quiet but at another rate: an even turn, or a rest whose bias moved while nobody looked.
        if self._odd and not self._near(mean, self._odd[0][1]):
            self._odd.clear()
        self._odd.append((begun, mean))
        if ended - self._odd[0][0] < self.knobs.new_reference_s:
            return False
        self._reference, self._anchor = mean, None
        self._odd.clear()
        return True

    def _learn(self, quiet: _Quiet, *, still: bool) -> None:
        rest = self._rest
        if not still:
            rest.clear()
            self._anchor = None
            return
        rest.append(quiet)
        # The first windows of a stream may still be the end of a movement: wait for some in a row.
        if self._reference is None and len(rest) < 4:
            return
        x, y, z, *stds, rates = zip(*rest, strict=True)
        n = len(rest)
        self._reference = [fsum(x) / n, fsum(y) / n, fsum(z) / n]
        if self._anchor is None and n >= 4:
            self._anchor = self._reference
        if n >= 8:
            self._learnt(np.array([_median(axis) for axis in stds]))
            self.noise_known = True
            self._noise_hz = sorted(rates)[n // 2]

    def _learnt(self, noise_std: Floats) -> None:
        """From now on noise_std (3,) rad/s is the white noise of one reading."""
        self.noise_std = noise_std
        self._limits = self._limits_at(1.0)

    def _limits_at(self, denser: float) -> Three:
        """What a still window's standard deviations stay below, with so many times the noise."""
        knobs = self.knobs
        return [
            min(max(knobs.noise_factor * denser * std, knobs.std_floor), knobs.std_ceiling)
            for std in self.noise_std.tolist()
        ]


def _median(values: Sequence[float]) -> float:
    """The same as of the standard library, in half its time."""
    ordered, middle = sorted(values), len(values) // 2
    return ordered[middle] if len(ordered) % 2 else (ordered[middle - 1] + ordered[middle]) / 2
