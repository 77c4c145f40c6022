"""Still or moving: the stream cut into short windows, each judged against the device's own noise and its own rest.

Limits follow the device: a large turn-on bias is no movement, so rates are compared with the mean of the last rest,
never with zero. A reading alone far from both its neighbours, a spike, is no movement of anything; it is replaced by their mean.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from math import radians
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.reasons.codes import Code, Sentences
from estimator.kernels.stillness import NOISE, SUMMED, TOLD, judged, nothing_known
from estimator.samples.sample_buffer import ACCEL, CELSIUS, CLIPPED, GYRO, TIME, WIDTH, SampleBuffer
from estimator.state import StateStruct, shaped

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


def too_seldom(rate_hz: float, knobs: StillnessKnobs) -> Sentences:
    """Why nothing of so many samples a second is ever still: between any two something may have happened; () of more."""
    least = 1 / knobs.gap_s
    if not 0 < rate_hz < 1.05 * least:  # of just as many one or the other comes late
        return ()
    return (Code.RATE_TOO_LOW(rate_hz=f"{rate_hz:.1f}", least_hz=f"{least:g}"),)


class Window(NamedTuple):
    """A short run of n samples, rows (n, 9) of `device.samples`; spikes mended, of which there were so many.

    `end` counts samples since the first one fed. summed (12,): mean of gyro and accel, their standard deviations.
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
        return self.summed[:3]

    @property
    def std(self) -> Floats:
        """(3,) of gyro."""
        return self.summed[6:9]

    @property
    def accel_mean(self) -> Floats | None:
        """(3,)."""
        return self.summed[3:6] if self.aided else None

    @property
    def accel_std(self) -> Floats | None:
        """(3,)."""
        return self.summed[9:] if self.aided else None

    @property
    def samples(self) -> int:
        """How many samples it has."""
        return self.end - self.start

    @property
    def rate_hz(self) -> float:
        """Samples a second."""
        return (self.samples - 1) / (self.end_time - self.start_time)


class Windows:
    """Windows in a row, as kernels/stillness.py has found them (m, 22) in rows (n, 9) of `device.samples`.

    The first of those rows is sample number `first` since the first one fed, the first window begins with rows[begin].
    """

    __slots__ = ("begin", "first", "found", "rows")

    def __init__(self, found: Floats, rows: Floats, first: int, begin: int = 0) -> None:
        self.found, self.rows, self.first, self.begin = found, rows, first, begin

    def __len__(self) -> int:
        return len(self.found)

    def __iter__(self) -> Iterator[Window]:
        return map(self.__getitem__, range(len(self)))

    def __getitem__(self, index: int) -> Window:
        found, first, begin = self.found[index], self.first, self._behind(index)
        begun, ended, behind, spikes, still, aided = found[:6].tolist()
        end = int(behind)
        rows, summed = self.rows[begin:end], found[SUMMED]
        return Window(first + begin, first + end, begun, ended, rows, summed, int(spikes), still > 0, aided > 0)

    def part(self, index: int, end: int | None = None) -> "Windows":
        """Some of them."""
        return Windows(self.found[index:end], self.rows, self.first, self._behind(index))

    def each(self) -> Iterator["Windows"]:
        """One after the other."""
        return (self.part(i, i + 1) for i in range(len(self)))

    @property
    def heads(self) -> list[tuple[float, float, int, bool]]:
        """Of each its begin and end, s, the number of its last sample, and whether it is still."""
        first = self.first - 1
        return [
            (begun, ended, first + int(end), still > 0) for begun, ended, end, _, still in self.found[:, :5].tolist()
        ]

    @property
    def celsius(self) -> list[float]:
        """°C at the last sample of each, NaN where it is not known."""
        temperatures: list[float] = self.rows[self.found[:, 2].astype(np.intp) - 1, CELSIUS].tolist()
        return temperatures

    @property
    def samples(self) -> tuple[int, Floats]:
        """Their samples (n, 9), and the number of the first of them."""
        end = int(self.found.item(-1, 2)) if len(self) else self.begin
        return self.first + self.begin, self.rows[self.begin : end]

    @property
    def moved(self) -> float | None:
        """When the last of them did that was not still, s; None where all were."""
        moving = self.found[self.found[:, 4] == 0.0, 1]
        return float(moving[-1]) if len(moving) else None

    def noise_std(self, index: int) -> Floats:
        """(3,) rad/s, white noise of one reading, as it was known when a window closed."""
        return self.found[index, NOISE]

    def _behind(self, index: int) -> int:
        """Where in the rows a window begins."""
        return int(self.found.item(index - 1, 2)) if index else self.begin


class StillnessState(StateStruct):
    """state (5, 4) and recent (16, 7): see kernels/stillness.py. next: number of the first sample of the next window."""

    state: Floats
    recent: Floats
    noise_std: Floats
    noise_known: bool
    next: int


class Stillness:
    """Samples in, judged windows out; the cut depends on the samples alone, never on how they were batched."""

    def __init__(self, knobs: StillnessKnobs | None = None) -> None:
        self.knobs = knobs or StillnessKnobs()
        #: (3,) rad/s, white noise of one reading, as it was known when the latest window closed
        self.noise_std: Floats = np.full(3, self.knobs.noise_guess)
        self.noise_known = False
        self._numbers = _numbers(self.knobs)
        self._state, self._recent = nothing_known(self.knobs.noise_guess)
        self._next = 0  # the number of the first sample of the next window
        self._own = SampleBuffer()

    @property
    def saved(self) -> StillnessState:
        """All that evolves, beside the samples from `next` on."""
        return StillnessState(self._state, self._recent, self.noise_std, self.noise_known, self._next)

    def resume(self, saved: StillnessState) -> None:
        """Go on from what was saved. Raises ValueError."""
        state, recent = nothing_known(self.knobs.noise_guess)
        shaped(saved.state, *state.shape)
        shaped(saved.recent, *recent.shape)
        shaped(saved.noise_std, 3, finite=True)
        if not 0 <= saved.state[1, 0] < 2**53:
            raise ValueError("damaged state: no state of stillness")
        self._state, self._recent, self._next = saved.state, saved.recent, saved.next
        self.noise_std, self.noise_known = saved.noise_std, saved.noise_known

    @property
    def fed(self) -> int:
        """How many samples were fed."""
        return self._own.end

    def feed(self, time: Floats, gyro: Floats, accel: Floats | None, clipped: Flags | None = None) -> Windows:
        """Take samples (n,), (n, 3), (n, 3), (n,); the windows that close."""
        rows = np.full((len(time), WIDTH), np.nan)
        rows[:, TIME], rows[:, GYRO] = time, gyro
        rows[:, CLIPPED] = 0.0 if clipped is None else clipped
        if accel is not None:
            rows[:, ACCEL] = accel
        return self.feed_rows(rows)

    def feed_rows(self, rows: Floats) -> Windows:
        """The same of rows (n, 9) of `device.samples`."""
        self._own.put([(rows, np.zeros((len(rows), 3), np.int64))])
        windows = self.take(self._own, self._own.end)
        self._own.forget(self._next)
        return windows

    def take(self, buffer: SampleBuffer, end: int) -> Windows:
        """The windows that close with the samples of a buffer up to before the one of this number; spikes are mended there."""
        first = self._next
        waiting = buffer.rows(first, end)
        found = judged(waiting, self._state, self._recent, self._numbers)
        if len(found):
            self._next += int(found.item(-1, 2))
            self.noise_known = self.noise_known or bool(found[:, TOLD].any())
            self.noise_std = found[-1, NOISE]
        return Windows(found, waiting, first)


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
