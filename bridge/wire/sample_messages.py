"""Message types with sample arrays: readings, corrected rates, revisions of past biases, and windowed statistics.

Rates are in rad/s, accelerations in m/s², times in seconds unless the name says otherwise. Vectors are in the sensor frame.
Arrays are read-only by convention: no code writes into a message.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import IntEnum, IntFlag
from typing import TypeVar, dataclass_transform

import numpy as np
from numpy.typing import NDArray

from bridge.reasons.codes import Sentences

Floats = NDArray[np.float64]
T = TypeVar("T")
#: (3,) rad/s: flicker_std of a message without one
STEADY = np.zeros(3, np.float32)


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def frequent(*, eq: bool) -> Callable[[type[T]], type[T]]:
    """Declare a dataclass for messages made very often: frozen for type checkers only.

    Creating an instance of a really frozen dataclass takes eight times as long. eq: whether to generate `==`.
    """
    return dataclass(slots=True, eq=eq)


class SampleFlag(IntFlag):
    """Bits of a sample's `flags`: after a gap, clipped, stuck, received late, temperature step. See truerate.proto."""

    OK = 0
    AFTER_GAP = 1
    CLIPPED = 2
    STUCK = 4
    LATE = 8
    TEMPERATURE_STEP = 16


class Quality(IntEnum):
    """Quality of a corrected rate, from NONE to GOOD; DEGRADED when evidence is old or contradicts it.

    NONE: data sheet's scale, bias unknown. PRIOR: scale of an earlier boot, bias unknown. BIAS_ONLY: bias of this boot
    known.
    GOOD: calibrated in this boot, bias tracked.
    """

    NONE = 0
    PRIOR = 1
    BIAS_ONLY = 2
    GOOD = 3
    DEGRADED = 4


class Timed:
    """Base of batches: device times and host times of their samples, from ticks and clock.

    ticks (n,) uint64: of tick_period_s seconds each. start_time_ns: host time of the first sample, ns since the Unix
    epoch. clock_rate: host seconds per device second.
    """

    __slots__ = ()
    start_time_ns: int
    tick_period_s: float
    clock_rate: float
    ticks: NDArray[np.uint64]

    def __len__(self) -> int:
        return len(self.ticks)

    @property
    def device_time(self) -> Floats:
        """Device time (n,) of each sample in s, by the device's own clock and zero."""
        return np.asarray(self.ticks * self.tick_period_s, dtype=np.float64)

    @property
    def sample_time_ns(self) -> NDArray[np.int64]:
        """Host time (n,) int64 at which each sample was taken, ns since the Unix epoch."""
        since_first = (self.ticks - self.ticks[0]) * (self.tick_period_s * self.clock_rate * 1e9)
        return np.asarray(np.rint(since_first).astype(np.int64) + self.start_time_ns, dtype=np.int64)


@frequent(eq=False)
class SampleBatch(Timed):
    """Raw samples: n consecutive samples of one boot, without a gap.

    ticks (n,) uint64, device time in ticks of tick_period_s; gyro (n, 3) float32 rad/s; accel (n, 3) float32 m/s² or
    None; temperature_c (n,) float32 °C or None; flags (n,) uint32 (SampleFlag). `sequence` is the number of the first
    sample since boot. receive_time_ns and start_time_ns: host times, ns since the Unix epoch, when the batch was
    received and the first sample was taken. clock_rate: host seconds per device second. `bridge` is the id of the
    publishing bridge, from the key.
    """

    device: str
    boot: int
    sequence: int
    receive_time_ns: int
    start_time_ns: int
    tick_period_s: float
    clock_rate: float
    ticks: NDArray[np.uint64]
    gyro: NDArray[np.float32]
    accel: NDArray[np.float32] | None
    temperature_c: NDArray[np.float32] | None
    flags: NDArray[np.uint32]
    bridge: str = ""

    def after(self, n: int) -> "SampleBatch":
        """Return the batch without its first n samples, n smaller than the batch."""
        return replace(
            self,
            sequence=self.sequence + n,
            start_time_ns=int(self.sample_time_ns[n]),
            ticks=self.ticks[n:],
            gyro=self.gyro[n:],
            accel=None if self.accel is None else self.accel[n:],
            temperature_c=None if self.temperature_c is None else self.temperature_c[n:],
            flags=self.flags[n:],
        )


@frequent(eq=False)
class OrientationBatch(Timed):
    """Attitudes of consecutive samples of one boot, from sensor to earth axes, z up (docs/orientation.md).

    quat_wxyz (n, 4) float32: unit quaternions, scalar first. linear_accel (n, 3) float32 m/s²: acceleration without
    gravity, earth axes; None without an accelerometer. covariance (3, 3) float32 rad²: of the attitude error at the
    last sample, a small rotation about earth axes. zero_sequence: number of the sample at which the heading was zero.
    zero: `start`, or who reset it. Other fields are as in CorrectedBatch.
    """

    device: str
    boot: int
    sequence: int
    start_time_ns: int
    tick_period_s: float
    clock_rate: float
    ticks: NDArray[np.uint64]
    quat_wxyz: NDArray[np.float32]
    linear_accel: NDArray[np.float32] | None
    covariance: NDArray[np.float32]
    zero_sequence: int
    zero: str
    quality: Quality
    epoch: int = 0

    @property
    def tilt_std(self) -> float:
        """Standard deviation of the tilt: rms angle between the true and the estimated vertical, rad."""
        return math.sqrt(float(self.covariance[0, 0]) + float(self.covariance[1, 1]))

    @property
    def heading_std(self) -> float:
        """Standard deviation of the heading since its zero, rad."""
        return math.sqrt(float(self.covariance[2, 2]))

    @property
    def heading(self) -> NDArray[np.float64]:
        """Heading (n,) since its zero, rad, -π to π: the rotation about the vertical that is left without the tilt."""
        w, z = self.quat_wxyz[:, 0].astype(float), self.quat_wxyz[:, 3].astype(float)
        return np.asarray(np.arctan2(2 * w * z, w * w - z * z))


@frequent(eq=False)
class CorrectedBatch(Timed):
    """Corrected rates of one SampleBatch (sensor frame), with bias and standard deviations.

    rate (n, 3) float32 rad/s; bias and every `_std` (3,) float32. bias, noise_std, bias_std and flicker_std are in
    rad/s; scale_std and cross_std are relative. bias_std is for the bias averaged over minutes, flicker_std for its
    flicker about that average. calibration: id of the calibration in use. The clock fields are as in SampleBatch.
    """

    device: str
    boot: int
    sequence: int
    start_time_ns: int
    tick_period_s: float
    clock_rate: float
    ticks: NDArray[np.uint64]
    rate: NDArray[np.float32]
    flags: NDArray[np.uint32]
    quality: Quality
    noise_std: NDArray[np.float32]
    bias_std: NDArray[np.float32]
    scale_std: NDArray[np.float32]
    bias: NDArray[np.float32]
    calibration: str
    cross_std: NDArray[np.float32]
    epoch: int = 0  # of the estimator's ownership of the device: a higher epoch is later; 0 when unknown
    flicker_std: NDArray[np.float32] = field(default_factory=lambda: STEADY)

    def after(self, n: int) -> "CorrectedBatch":
        """Return the batch without its first n samples, n smaller than the batch."""
        return replace(
            self,
            sequence=self.sequence + n,
            start_time_ns=int(self.sample_time_ns[n]),
            ticks=self.ticks[n:],
            rate=self.rate[n:],
            flags=self.flags[n:],
        )

    @property
    def rate_std(self) -> Floats:
        """Standard deviation (n, 3) of each corrected rate, rad/s.

        Combines noise, bias, flicker, scale and misalignment.
        """
        return combined_std(self.rate, self.noise_std, self.bias_std, self.scale_std, self.cross_std, self.flicker_std)


def combined_std(
    rate: NDArray[np.floating],
    noise_std: NDArray[np.floating],
    bias_std: NDArray[np.floating],
    scale_std: NDArray[np.floating],
    cross_std: NDArray[np.floating],
    flicker_std: NDArray[np.floating],
) -> Floats:
    """Return the (n, 3) standard deviation, rad/s, of corrected rates (n, 3) rad/s, from the parts of a CorrectedBatch.

    Each part is (3,) for all samples or (n, 3) per sample: noise, bias and flicker in rad/s, scale and cross-axis
    relative.
    """
    rate_var = rate.astype(float) ** 2
    across_var = rate_var.sum(axis=1, keepdims=True) - rate_var
    var = rate_var * scale_std.astype(float) ** 2 + across_var * cross_std.astype(float) ** 2
    var += noise_std.astype(float) ** 2 + bias_std.astype(float) ** 2 + flicker_std.astype(float) ** 2
    return np.asarray(np.sqrt(var), dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class BiasRevision:
    """Revised bias of past samples: m points, each at a sample, linear in time between points.

    A revision applies to the CorrectedBatches of the same device, boot and calibration. time_ns: when it was made.
    matrix: (3, 3), the calibration matrix in use.
    sequences: (m,) uint64, sample numbers, rising. times_ns: (m,) int64, host time of these samples, rising.
    bias, bias_std: (m, 3) float32 rad/s, of the reading, not of the corrected rate.
    """

    device: str
    boot: int
    calibration: str
    time_ns: int
    matrix: Floats
    sequences: NDArray[np.uint64]
    times_ns: NDArray[np.int64]
    bias: NDArray[np.float32]
    bias_std: NDArray[np.float32]
    reason: Sentences

    def __len__(self) -> int:
        return len(self.sequences)


@dataclass(frozen=True, slots=True, eq=False)
class WindowBatch:
    """Statistics of samples in m windows of window_s device seconds each, for display.

    sequences: (m,) uint64, number of each window's last sample. times_ns: (m,) int64, host time of that sample.
    samples: (m,) uint32, number of samples per window. flags: (m,) uint32, flags of all samples of a window combined.
    reading_…, rate_…: (m, 3) float32 rad/s, statistics of readings and of corrected rates.
    Other fields are as in the CorrectedBatch of the last sample.
    """

    device: str
    boot: int
    window_s: float
    sequences: NDArray[np.uint64]
    times_ns: NDArray[np.int64]
    samples: NDArray[np.uint32]
    flags: NDArray[np.uint32]
    reading_mean: NDArray[np.float32]
    reading_std: NDArray[np.float32]
    reading_min: NDArray[np.float32]
    reading_max: NDArray[np.float32]
    rate_mean: NDArray[np.float32]
    rate_std: NDArray[np.float32]
    rate_min: NDArray[np.float32]
    rate_max: NDArray[np.float32]
    quality: Quality
    noise_std: NDArray[np.float32]
    bias_std: NDArray[np.float32]
    scale_std: NDArray[np.float32]
    cross_std: NDArray[np.float32]
    bias: NDArray[np.float32]
    calibration: str
    flicker_std: NDArray[np.float32] = field(default_factory=lambda: STEADY)

    def __len__(self) -> int:
        return len(self.samples)

    @property
    def rate_mean_std(self) -> Floats:
        """Standard deviation (m, 3) of each window's mean corrected rate, rad/s.

        Averaging reduces noise, but not the other errors.
        """
        noise = self.noise_std / np.sqrt(self.samples.astype(float))[:, None]
        return combined_std(self.rate_mean, noise, self.bias_std, self.scale_std, self.cross_std, self.flicker_std)
