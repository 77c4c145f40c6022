"""Still or moving: the stream cut into short windows, each judged against the device's own noise and its own rest.

Limits follow the device: a large turn-on bias is no movement, so rates are compared with the mean of the last rest,
never with zero.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from math import radians

import numpy as np
from numpy.typing import NDArray

from estimator.gyro import spread
from estimator.spikes import SpikeKnobs, mended

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
#: time, gyro, accel or None, clipped
_Samples = tuple[Floats, Floats, Floats | None, Flags]
#: a window is made longer by so many samples at most, so as not to end at a spike
_SPIKE_AND_BACK = 2


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
    def start_time(self) -> float:
        """Of its first sample."""
        return float(self.time[0])

    @property
    def end_time(self) -> float:
        """Of its last sample."""
        return float(self.time[-1])


class Stillness:
    """Samples in, judged windows out; the cut depends on the samples alone, never on how they were batched."""

    def __init__(self, knobs: StillnessKnobs | None = None) -> None:
        self.knobs = knobs or StillnessKnobs()
        self.noise_std = np.full(3, self.knobs.noise_guess)
        self.noise_known = False
        self._reference: Floats | None = None
        self._anchor: Floats | None = None  # the reference when this rest began: a slow turn must not drag it along
        self._last: tuple[float, Floats] | None = None  # time and reading
        self._rest_windows: list[Window] = []
        self._odd: list[Window] = []
        self._count = 0
        self._held: list[_Samples] = []

    def feed(self, time: Floats, gyro: Floats, accel: Floats | None, clipped: Flags | None = None) -> Iterator[Window]:
        """Take samples (n,), (n, 3), (n, 3), (n,) and yield each window as it closes; consume it all before feeding again."""
        if not len(time):
            return
        self._held.append((time, gyro, accel, np.zeros(len(time), bool) if clipped is None else clipped))
        while (n := self._whole()) is not None:
            yield self._close(self._draw(n))

    def _whole(self) -> int | None:
        """How many of the samples that are held make a window; None when they do not yet."""
        if not self._held or self._held[-1][0][-1] - self._held[0][0][0] < self.knobs.window_s:
            return None
        self._held = [_together(self._held)]
        time, gyro, _, _ = self._held[0]
        n = max(self.knobs.min_samples, int(np.searchsorted(time - time[0], self.knobs.window_s)) + 1)
        # A window does not end at a spike: what follows it tells that it is one.
        for more in range(_SPIKE_AND_BACK):
            if n + more > len(time):
                return None
            if np.abs(gyro[n + more - 1] - gyro[n + more - 2]).max() <= self.knobs.spike.far:
                return n + more
        return n + _SPIKE_AND_BACK if n + _SPIKE_AND_BACK <= len(time) else None

    def _draw(self, n: int) -> _Samples:
        """The first n of the samples that are held."""
        time, gyro, accel, clipped = self._held.pop()
        if n < len(time):
            self._held.append((time[n:], gyro[n:], None if accel is None else accel[n:], clipped[n:]))
        return time[:n], gyro[:n], None if accel is None else accel[:n], clipped[:n]

    def _close(self, samples: _Samples) -> Window:
        time, gyro, accel, clipped = samples
        start, self._count = self._count, self._count + len(time)
        last_time, last_gyro = self._last or (time[0], gyro[0])
        silence = float(np.diff(time, prepend=last_time).max())
        gyro, spiked = mended(last_gyro if time[0] - last_time < self.knobs.gap_s else gyro[0], gyro, self.knobs.spike)
        self._last = time[-1], gyro[-1]
        if silence >= self.knobs.gap_s:
            self._odd.clear()
        # One that was mended is no longer clipped.
        clipped = clipped if spiked is None else clipped & ~spiked
        mean, std = spread(gyro)
        accel_mean, accel_std = (None, None) if accel is None else spread(accel)
        if accel_mean is not None and np.isnan(accel_mean[0]):
            accel = accel_mean = accel_std = None
        spikes = 0 if spiked is None else int(spiked.sum())
        draft = Window(
            start, self._count, time, gyro, accel, clipped, mean, std, accel_mean, accel_std, spikes, still=False
        )
        window = replace(draft, still=silence < self.knobs.gap_s and self._judge(draft))
        self._learn(window)
        return window

    def _judge(self, window: Window) -> bool:
        if not self._quiet(window):
            self._odd.clear()
            return False
        if self._reference is None or self._near(window.mean, self._reference):
            if self._anchor is None or self._near(window.mean, self._anchor):
                self._odd.clear()
                return True
            self._reference = self._anchor
        return self._adopt_odd(window)

    def _quiet(self, window: Window) -> bool:
        limit = np.clip(self.knobs.noise_factor * self.noise_std, self.knobs.std_floor, self.knobs.std_ceiling)
        calm = window.accel_std is None or bool(np.all(window.accel_std <= self.knobs.accel_std))
        return calm and bool(np.all(window.std <= limit))

    def _near(self, mean: Floats, reference: Floats) -> bool:
        return bool(np.all(np.abs(mean - reference) < self.knobs.mean_tolerance))

    def _adopt_odd(self, window: Window) -> bool:
        # Quiet but at another rate: an even turn, or a rest whose bias moved while nobody looked.
        if self._odd and not self._near(window.mean, self._odd[0].mean):
            self._odd.clear()
        self._odd.append(window)
        if window.end_time - self._odd[0].start_time < self.knobs.new_reference_s:
            return False
        self._reference, self._anchor = window.mean, None
        self._odd.clear()
        return True

    def _learn(self, window: Window) -> None:
        if not window.still:
            self._rest_windows.clear()
            self._anchor = None
            return
        self._rest_windows.append(window)
        recent = self._rest_windows = self._rest_windows[-16:]
        # The first windows of a stream may still be the end of a movement: wait for some in a row.
        if self._reference is None and len(recent) < 4:
            return
        self._reference = np.mean([w.mean for w in recent], axis=0)
        if self._anchor is None and len(recent) >= 4:
            self._anchor = self._reference
        if len(recent) >= 8:
            self.noise_std = np.median([w.std for w in recent], axis=0)
            self.noise_known = True


def _together(parts: list[_Samples]) -> _Samples:
    """Some parts as one; where some know no acceleration it is NaN there."""
    if len(parts) == 1:
        return parts[0]
    times, gyros, accels, flags = zip(*parts, strict=True)
    known = any(accel is not None for accel in accels)
    forces = [
        np.full((len(time), 3), np.nan) if accel is None else accel for time, accel in zip(times, accels, strict=True)
    ]
    accel = np.concatenate(forces) if known else None
    return np.concatenate(times), np.concatenate(gyros), accel, np.concatenate(flags)
