"""Still or moving: the stream cut into short windows, each judged against the device's own noise and its own rest.

Limits follow the device: a large turn-on bias is no movement, so rates are compared with the mean of the last rest,
never with zero.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import radians, sqrt

import numpy as np
from numpy.typing import NDArray

from estimator.gyro import spread
from estimator.held import Held
from estimator.spikes import SpikeKnobs, mended

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Three = list[float]
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
        self._rest = np.zeros((_RECENT, 2, 3))  # mean and std of the latest windows of a rest
        self._rates = [0.0] * _RECENT  # and their rates
        self._rested = 0  # how many of them there are
        self._odd: list[tuple[float, Three]] = []  # start and mean
        self._count = 0
        self._held = Held()

    def feed(self, time: Floats, gyro: Floats, accel: Floats | None, clipped: Flags | None = None) -> Iterator[Window]:
        """Take samples (n,), (n, 3), (n, 3), (n,) and yield each window as it closes; consume it all before feeding again."""
        self._held.put(time, gyro, accel, clipped)
        while n := self._whole():
            yield self._close(n)

    def _whole(self) -> int:
        """How many of the samples that are held make a window; 0 when they do not yet."""
        held = self._held
        if len(held) < self.knobs.min_samples or held.span < self.knobs.window_s:
            return 0
        time = held.time
        n = max(self.knobs.min_samples, int(np.searchsorted(time, time[0] + self.knobs.window_s)) + 1)
        # A window does not end at a spike: what follows it tells that it is one.
        most = n + _SPIKE_AND_BACK
        while n <= len(time) and n < most and held.leap(n - 1) > self.knobs.spike.far:
            n += 1
        return n if n <= len(time) else 0

    def _close(self, n: int) -> Window:
        time, read, clipped = self._held.draw(n)
        start, self._count = self._count, self._count + n
        begun, ended = float(time[0]), float(time[-1])
        last_time, last_gyro = self._last or (begun, read[0, :3])
        mean, std = spread(read)
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
        self._learn(mean[:3], std[:3], rate_hz, still=still)
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

    def _learn(self, mean: Floats, std: Floats, rate_hz: float, *, still: bool) -> None:
        if not still:
            self._rested, self._anchor = 0, None
            return
        rest = self._rest
        rest[:-1] = rest[1:]
        rest[-1] = mean, std
        self._rates = [*self._rates[1:], rate_hz]
        recent = self._rested = min(self._rested + 1, _RECENT)
        # The first windows of a stream may still be the end of a movement: wait for some in a row.
        if self._reference is None and recent < 4:
            return
        self._reference = (np.add.reduce(rest[-recent:, 0]) / recent).tolist()
        if self._anchor is None and recent >= 4:
            self._anchor = self._reference
        if recent >= 8:
            ordered = rest[-recent:, 1].copy()
            ordered.sort(axis=0)
            self._learnt((ordered[(recent - 1) // 2] + ordered[recent // 2]) / 2)
            self.noise_known = True
            self._noise_hz = sorted(self._rates[-recent:])[recent // 2]

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
