"""Still or moving: the stream cut into short windows, each judged against the device's own noise and its own rest.

Limits follow the device: a large turn-on bias is no movement, so rates are compared with the mean of the last rest,
never with zero. A reading alone far from both its neighbours, a spike, is no movement of anything; it is replaced by their mean.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from math import radians
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.block import ACCEL, GYRO, TIME
from estimator.held import CLIPPED, Held
from estimator.loops.windows import judged, nothing_known

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class SpikeKnobs:
    """When a reading is a spike."""

    #: rad/s from the mean of its neighbours, which a tap does not reach, and so many times farther than is usual around it
    far: float = radians(200.0)
    factor: float = 10.0
    #: and than those beside it
    alone: float = 1.5


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


class Window(NamedTuple):
    """A short run of n samples, rows (n, 8): time, gyro, accel, and 1 where clipped; spikes mended, of which there were so many.

    `end` counts samples since the first one fed. summed (4, 3): mean of gyro and accel, their standard deviations.
    aided: whether there was an accelerometer all the time.
    """

    start: int
    end: int
    start_time: float
    end_time: float
    rows: Floats
    summed: Floats
    spikes: int
    still: bool
    aided: bool

    @property
    def time(self) -> Floats:
        """(n,) s."""
        return self.rows[:, TIME]

    @property
    def gyro(self) -> Floats:
        """(n, 3) rad/s."""
        return self.rows[:, GYRO]

    @property
    def accel(self) -> Floats | None:
        """(n, 3) m/s²."""
        return self.rows[:, ACCEL] if self.aided else None

    @property
    def clipped(self) -> Flags:
        """(n,)."""
        return np.asarray(self.rows[:, CLIPPED] != 0)

    @property
    def mean(self) -> Floats:
        """(3,) of gyro."""
        return np.asarray(self.summed[0])

    @property
    def std(self) -> Floats:
        """(3,) of gyro."""
        return np.asarray(self.summed[2])

    @property
    def accel_mean(self) -> Floats | None:
        """(3,)."""
        return self.summed[1] if self.aided else None

    @property
    def accel_std(self) -> Floats | None:
        """(3,)."""
        return self.summed[3] if self.aided else None

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
        #: (3,) rad/s, white noise of one reading, as it was known when the latest window closed
        self.noise_std: Floats = np.full(3, self.knobs.noise_guess)
        self.noise_known = False
        self._numbers = _numbers(self.knobs)
        self._state, self._recent = nothing_known(self.knobs.noise_guess)
        self._count = 0
        self._held = Held()

    def feed(self, time: Floats, gyro: Floats, accel: Floats | None, clipped: Flags | None = None) -> Iterator[Window]:
        """Take samples (n,), (n, 3), (n, 3), (n,) and yield each window as it closes; consume it all before feeding again."""
        rows = np.full((len(time), CLIPPED), np.nan)
        rows[:, TIME], rows[:, GYRO] = time, gyro
        if accel is not None:
            rows[:, ACCEL] = accel
        return self.take([rows], clipped)

    def take(self, parts: Sequence[Floats], clipped: Flags | None = None) -> Iterator[Window]:
        """The same of rows (n, 7), as the parts of a block have them."""
        held = self._held
        held.put(parts, clipped)
        waiting = held.waiting
        found = judged(waiting, self._state, self._recent, self._numbers)
        if not len(found):
            return
        heads, begin, count = found[:, :7].tolist(), 0, self._count
        held.drop(int(heads[-1][2]))
        self._count += int(heads[-1][2])
        for i, (head, summed) in enumerate(zip(heads, found[:, 7:19].reshape(-1, 4, 3), strict=True)):
            begun, ended, last, spikes, still, aided, told = head
            if told:
                self.noise_std, self.noise_known = found[i, 19:], True
            end = int(last)
            rows = waiting[begin:end]
            yield Window(count + begin, count + end, begun, ended, rows, summed, int(spikes), still > 0, aided > 0)
            begin = end


@cache
def _numbers(knobs: StillnessKnobs) -> tuple[float, ...]:
    """The knobs, in the order in which the loop takes them apart; the very same of all devices that have the same."""
    spike = knobs.spike
    numbers = (
        *(knobs.window_s, knobs.min_samples, knobs.noise_factor, knobs.std_floor, knobs.accel_std),
        *(knobs.mean_tolerance, knobs.new_reference_s, knobs.std_ceiling, knobs.gap_s),
        *(spike.far, spike.factor, spike.alone),
    )
    return tuple(float(number) for number in numbers)
