"""Stillness detector: cuts the sample stream into short windows and judges each as still or moving.

A window is still if its scatter is within a multiple of the device's own noise, and if its mean is near that of the
last rest. The comparison is not with zero, so a large turn-on bias does not count as movement.
A spike is a single reading far from both its neighbours. It is replaced by their mean, and does not count as movement.
"""

from collections.abc import Iterator
from math import radians
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.reasons.codes import Code, Sentences
from estimator.kernels.stillness import NOISE, SUMMED, TOLD, judged, nothing_known
from estimator.samples.sample_buffer import ACCEL, CELSIUS, CLIPPED, GYRO, TIME, WIDTH, SampleBuffer
from estimator.state import Floats, StateStruct, shaped

Flags = NDArray[np.bool_]


#: least length of a window, s, and its least number of samples
WINDOW_S, MIN_SAMPLES = 0.125, 6
#: rad/s, white noise of one reading, assumed until a rest has shown it
NOISE_GUESS = radians(0.15)
#: a window is still when its standard deviation stays below this multiple of the noise ...
NOISE_FACTOR = 5.0
#: ... or below this, rad/s, so that a very quiet device is not disturbed by a footfall
STD_FLOOR = radians(0.2)
#: m/s², largest standard deviation of a still window's accelerometer readings
ACCEL_STD = 0.3
#: rad/s, largest distance of a still window's mean from the mean of the last rest
MEAN_TOLERANCE = radians(1.5)
#: s; a constant rate of at least this long is a new rest: no hand turns so evenly
NEW_REFERENCE_S = 20.0
#: rad/s; more than this is movement for any learnt noise: a tremor must not be learnt as rest
STD_CEILING = radians(1.5)
#: s; stillness does not span a gap of this length: a movement may hide in it
GAP_S = 0.25
#: a spike: its least distance from the mean of its neighbours, rad/s, which a tap does not reach; the same as a multiple of
#: the usual distance, and of the distances of the readings beside it
SPIKE_FAR, SPIKE_FACTOR, SPIKE_ALONE = radians(200.0), 10.0, 1.5


def too_seldom(rate_hz: float) -> Sentences:
    """Reason text that a sample rate is too low for stillness detection; empty if the rate is high enough.

    rate_hz: sample rate, Hz. With GAP_S (0.25 s) or more between samples, a movement may hide between any two.
    """
    least = 1 / GAP_S
    if not 0 < rate_hz < 1.05 * least:  # margin of 5 %: at exactly the least rate some samples come late
        return ()
    return (Code.RATE_TOO_LOW(rate_hz=f"{rate_hz:.1f}", least_hz=f"{least:g}"),)


class Window(NamedTuple):
    """Short run of n samples, judged still or moving, with spikes corrected.

    rows (n, 9): device time (s), gyro (3, rad/s), accelerometer (3, m/s²), clipped or stuck (0 or 1), temperature (°C).
    start, end: numbers of the first sample and of the one after the last, counted from the first sample of the stream.
    start_time, end_time: device time of the first and the last sample, s.
    summed (12,): mean of gyro (3, rad/s) and accelerometer (3, m/s²), then their standard deviations in the same order.
    spikes: number of samples corrected.
    still: True if the window was judged still. aided: True if every sample has an accelerometer reading.
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
    def mean(self) -> Floats:
        """Mean gyro reading (3,), rad/s."""
        return self.summed[:3]

    @property
    def accel_mean(self) -> Floats | None:
        """Mean accelerometer reading (3,), m/s²; None without an accelerometer."""
        return self.summed[3:6] if self.aided else None

    @property
    def samples(self) -> int:
        """Number of samples in the window."""
        return self.end - self.start


class Windows:
    """Consecutive windows of a stream, with their judgements.

    rows (n, 9): device time (s), gyro (3, rad/s), accelerometer (3, m/s²), clipped or stuck (0 or 1), temperature (°C).
    found (m, 22): one row per window, as returned by the function `judged` in kernels/stillness.py.
    first: number of rows[0], counted from the first sample of the stream.
    begin: index in rows of the first window's first sample.
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
        """Select the windows from index `index` up to but not including `end` (None: all that follow).

        The result shares the rows.
        """
        return Windows(self.found[index:end], self.rows, self.first, self._behind(index))

    @property
    def heads(self) -> list[tuple[float, float, int, bool]]:
        """Tuples for each window: start and end in device time (s), number of its last sample, and True if it is still."""
        first = self.first - 1
        return [
            (begun, ended, first + int(end), still > 0) for begun, ended, end, _, still in self.found[:, :5].tolist()
        ]

    @property
    def samples(self) -> tuple[int, Floats]:
        """Number of the first sample, and the rows (n, 9) of all windows.

        Columns: device time (s), gyro (3, rad/s), accelerometer (3, m/s²), clipped or stuck (0 or 1), temperature (°C).
        """
        end = int(self.found.item(-1, 2)) if len(self) else self.begin
        return self.first + self.begin, self.rows[self.begin : end]

    @property
    def moved(self) -> float | None:
        """End of the last moving window in device time, s; None where all windows are still."""
        moving = self.found[self.found[:, 4] == 0.0, 1]
        return float(moving[-1]) if len(moving) else None

    def noise_std(self, index: int) -> Floats:
        """Standard deviation (3,) of the white noise of one gyro reading, rad/s, as known when window `index` closed."""
        return self.found[index, NOISE]

    def _behind(self, index: int) -> int:
        """Index in rows of a window's first sample."""
        return int(self.found.item(index - 1, 2)) if index else self.begin


class StillnessState(StateStruct):
    """Saved state of the stillness detector.

    state (5, 4), recent (16, 7): memory of the function `judged` in kernels/stillness.py, where each element is
        described.
    noise_std (3,): standard deviation of one gyro reading at rest, rad/s. noise_known: True if a rest has shown it.
    next: number of the first sample of the next window, counted from the first sample of the stream.
    """

    state: Floats
    recent: Floats
    noise_std: Floats
    noise_known: bool
    next: int


class Stillness:
    """Stillness detector: cuts samples into windows, and judges each as still or moving.

    noise_guess: standard deviation of one gyro reading at rest, rad/s, assumed until a rest has shown it.
    Window boundaries depend on the samples alone, never on how they are split into calls.
    """

    def __init__(self, noise_guess: float = NOISE_GUESS) -> None:
        #: (3,) rad/s, white noise of one reading, as known when the latest window closed
        self.noise_std: Floats = np.full(3, noise_guess)
        self.noise_known = False
        self._state, self._recent = nothing_known(noise_guess)
        self._next = 0  # number of the first sample of the next window
        self._own = SampleBuffer()

    @property
    def saved(self) -> StillnessState:
        """State to save for `resume`. The samples from number `next` on must be saved beside it."""
        return StillnessState(self._state, self._recent, self.noise_std, self.noise_known, self._next)

    def resume(self, saved: StillnessState) -> None:
        """Continue from a saved state. Raises ValueError for a damaged state."""
        shaped(saved.state, *self._state.shape)
        shaped(saved.recent, *self._recent.shape)
        shaped(saved.noise_std, 3, finite=True)
        if not 0 <= saved.state[1, 0] < 2**53:
            raise ValueError("damaged state: the data is not of a stillness detector; start without this state")
        self._state, self._recent, self._next = saved.state, saved.recent, saved.next
        self.noise_std, self.noise_known = saved.noise_std, saved.noise_known

    def feed(
        self,
        time: Floats,
        gyro: Floats,
        accel: Floats | None,
        clipped: Flags | None = None,
        celsius: NDArray[np.floating] | None = None,
    ) -> Windows:
        """Add n samples and return the windows that they complete, each judged still or moving.

        time (n,): device time, s. gyro (n, 3): rad/s. accel (n, 3): m/s², or None.
        clipped (n,): bool; None means that no reading is clipped. celsius (n,): °C, or None.
        """
        rows = np.full((len(time), WIDTH), np.nan)
        rows[:, TIME], rows[:, GYRO] = time, gyro
        rows[:, CLIPPED] = 0.0 if clipped is None else clipped
        if accel is not None:
            rows[:, ACCEL] = accel
        if celsius is not None:
            rows[:, CELSIUS] = celsius
        self._own.put([(rows, np.zeros((len(rows), 3), np.int64))])
        windows = self.take(self._own, self._own.end)
        self._own.forget(self._next)
        return windows

    def take(self, buffer: SampleBuffer, end: int) -> Windows:
        """Judge the samples of a shared buffer up to but not including number `end`; return the completed windows.

        Spikes are corrected in the buffer. Do not mix with `feed`, which has a buffer of its own.
        """
        first = self._next
        waiting = buffer.rows(first, end)
        numbers = (
            *(WINDOW_S, float(MIN_SAMPLES), NOISE_FACTOR, STD_FLOOR, ACCEL_STD, MEAN_TOLERANCE),
            *(NEW_REFERENCE_S, STD_CEILING, GAP_S, SPIKE_FAR, SPIKE_FACTOR, SPIKE_ALONE),
        )
        found = judged(waiting, self._state, self._recent, numbers)
        if len(found):
            self._next += int(found.item(-1, 2))
            self.noise_known = self.noise_known or bool(found[:, TOLD].any())
            self.noise_std = found[-1, NOISE]
        return Windows(found, waiting, first)
