"""Still or moving: the stream cut into short windows, each judged against the device's own noise and its own rest.

Limits follow the device: a large turn-on bias is no movement, so rates are compared with the mean of the last rest,
never with zero.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import radians

import numpy as np
from numpy.typing import NDArray

from estimator.gyro import spread

Floats = NDArray[np.float64]
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


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """A short run of samples: `end` counts samples since the first one fed; mean and std of its readings (3,)."""

    start: int
    end: int
    start_time: float
    end_time: float
    mean: Floats
    std: Floats
    accel_mean: Floats | None
    accel_std: Floats | None
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
        self.noise_std = np.full(3, self.knobs.noise_guess)
        self.noise_known = False
        self._noise_hz = 0.0  # the rate of the samples that showed it; 0 until then
        self._reference: Floats | None = None
        self._anchor: Floats | None = None  # the reference when this rest began: a slow turn must not drag it along
        self._last_time: float | None = None
        self._rest_windows: list[Window] = []
        self._odd: list[Window] = []
        self._count = 0
        self._time: list[Floats] = []
        self._gyro: list[Floats] = []
        self._accel: list[Floats] = []

    def feed(self, time: Floats, gyro: Floats, accel: Floats | None) -> Iterator[Window]:
        """Take samples (n,), (n, 3), (n, 3) and yield each window as it closes; consume it all before feeding again."""
        start = 0
        pending = sum(map(len, self._time))
        opened = self._time[0][0] if self._time else time[0]
        for i, t in enumerate(time):
            if pending + i + 1 - start >= self.knobs.min_samples and t - opened >= self.knobs.window_s:
                self._hold(time[start : i + 1], gyro[start : i + 1], None if accel is None else accel[start : i + 1])
                yield self._close()
                start, pending = i + 1, 0
                opened = time[start] if start < len(time) else t
        if start < len(time):
            self._hold(time[start:], gyro[start:], None if accel is None else accel[start:])

    def _hold(self, time: Floats, gyro: Floats, accel: Floats | None) -> None:
        self._time.append(time)
        self._gyro.append(gyro)
        if accel is not None:
            self._accel.append(accel)

    def _close(self) -> Window:
        time, gyro = np.concatenate(self._time), np.concatenate(self._gyro)
        # A window with an accelerometer in a part of it only is judged without.
        accel = np.concatenate(self._accel) if len(self._accel) == len(self._time) else None
        for held in (self._time, self._gyro, self._accel):
            held.clear()
        start, self._count = self._count, self._count + len(time)
        mean, std = spread(gyro)
        accel_mean, accel_std = (None, None) if accel is None else spread(accel)
        begun, ended = float(time[0]), float(time[-1])
        silence = max(
            float((time[1:] - time[:-1]).max()), begun - (begun if self._last_time is None else self._last_time)
        )
        self._last_time = ended
        if silence >= self.knobs.gap_s:
            self._odd.clear()
        draft = Window(start, self._count, begun, ended, mean, std, accel_mean, accel_std, still=False)
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
        # A device that is told to send faster averages over less: a reading's noise grows until it is learnt anew.
        ratio = window.rate_hz / self._noise_hz if self._noise_hz else 1.0
        denser = ratio**0.5 if ratio > _FASTER else 1.0
        limit = np.clip(self.knobs.noise_factor * denser * self.noise_std, self.knobs.std_floor, self.knobs.std_ceiling)
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
            self._noise_hz = float(np.median([w.rate_hz for w in recent]))
