"""Message types with sample arrays: readings, corrected rates, orientations, bias revisions and window statistics.

Rates are in rad/s, accelerations in m/s², times in s unless the name says otherwise. Vectors are in the sensor frame.
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
    """Declare a dataclass for messages that are made very often; only type checkers treat it as frozen.

    eq: True generates `==`. A dataclass frozen at run time takes eight times as long to make an instance.
    """
    return dataclass(slots=True, eq=eq)


class SampleFlag(IntFlag):
    """Bits of a sample's `flags`.

    AFTER_GAP: samples are missing before it. CLIPPED: an axis is at the end of its full-scale range.
    STUCK: readings repeat where noise should change them. LATE: received more than 1 s after it was taken.
    TEMPERATURE_STEP: the temperature changed faster than a sensor's can.
    """

    OK = 0
    AFTER_GAP = 1
    CLIPPED = 2
    STUCK = 4
    LATE = 8
    TEMPERATURE_STEP = 16


class Quality(IntEnum):
    """Quality of a corrected rate, by what is known about scale and bias.

    NONE: scale of the data sheet, bias unknown. PRIOR: scale of an earlier boot, bias unknown.
    BIAS_ONLY: bias of this boot known, scale not calibrated in this boot. GOOD: calibrated in this boot, bias tracked.
    DEGRADED: calibrated in this boot, but the evidence is old or contradicts the estimate.
    """

    NONE = 0
    PRIOR = 1
    BIAS_ONLY = 2
    GOOD = 3
    DEGRADED = 4


class Timed:
    """Base class of batches: computes device times and host times of n samples from the fields below.

    ticks (n,) uint64: device clock, tick_period_s each. start_time_ns: host time of the first sample, ns since the Unix
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
        """Time (n,) of each sample by the device's clock, s, counted from that clock's zero."""
        return np.asarray(self.ticks * self.tick_period_s, dtype=np.float64)

    @property
    def sample_time_ns(self) -> NDArray[np.int64]:
        """Host time (n,) int64 at which each sample was taken, ns since the Unix epoch."""
        since_first = (self.ticks - self.ticks[0]) * (self.tick_period_s * self.clock_rate * 1e9)
        return np.asarray(np.rint(since_first).astype(np.int64) + self.start_time_ns, dtype=np.int64)


@frequent(eq=False)
class SampleBatch(Timed):
    """Raw samples: n consecutive samples of one boot of a device, without a gap.

    gyro (n, 3) float32: rad/s, sensor frame. accel (n, 3) float32: m/s², sensor frame, or None.
    temperature_c (n,) float32, or None. flags (n,) uint32: SampleFlag bits.
    boot: 64-bit boot number. sequence: number of the first sample since boot.
    ticks (n,) uint64: device clock, tick_period_s each. clock_rate: host seconds per device second.
    start_time_ns: host time when the first sample was taken, ns since the Unix epoch. receive_time_ns: host time when
    the batch was received, ns since the Unix epoch. bridge: id of the publishing bridge, from the bus key.
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
        """Return the batch without its first n samples. n: smaller than the batch."""
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
    """Attitudes of n consecutive samples of one boot, from sensor to earth axes, z up (docs/orientation.md).

    quat_wxyz (n, 4) float32: unit quaternions, scalar first. linear_accel (n, 3) float32: acceleration without gravity,
    m/s², earth axes; None without an accelerometer.
    covariance (3, 3) float32: of the attitude error at the last sample, a small rotation about earth axes, rad².
    zero_sequence: number of the sample at which the heading was zero. zero: `start`, or the name of the person who
    reset the heading.
    boot: 64-bit boot number. sequence: number of the first sample since boot. epoch: number of the period in
    which the estimator owns the device; a later period has a higher number.
    ticks (n,) uint64: device clock, tick_period_s each.
    start_time_ns: host time of the first sample, ns since the Unix epoch. clock_rate: host seconds per device second.
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
        """Standard deviation of the tilt, rad: rms angle between the true and the estimated vertical."""
        return math.sqrt(float(self.covariance[0, 0]) + float(self.covariance[1, 1]))

    @property
    def heading_std(self) -> float:
        """Standard deviation of the change of heading since its zero, rad."""
        return math.sqrt(float(self.covariance[2, 2]))

    @property
    def heading(self) -> NDArray[np.float64]:
        """Heading (n,) since its zero, rad, -π to π: the twist about the vertical, by swing-twist decomposition."""
        w, z = self.quat_wxyz[:, 0].astype(float), self.quat_wxyz[:, 3].astype(float)
        return np.asarray(np.arctan2(2 * w * z, w * w - z * z))


@frequent(eq=False)
class CorrectedBatch(Timed):
    """Corrected rates of the n samples of one SampleBatch, with bias and standard deviations, sensor frame.

    rate (n, 3) float32: rad/s. bias (3,) float32: rad/s.
    noise_std, bias_std, flicker_std (3,) float32: rad/s. scale_std, cross_std (3,) float32: without unit.
    bias_std belongs to the bias averaged over minutes, flicker_std to the bias' flicker about that average.
    scale_std and cross_std: relative errors of scale and misalignment; `combined_std` states the effect of each.
    calibration: id of the calibration in use. flags (n,) uint32: SampleFlag bits.
    boot: 64-bit boot number. sequence: number of the first sample since boot. ticks (n,) uint64: device clock,
    tick_period_s each. start_time_ns: host time of the first sample, ns since the Unix epoch. clock_rate: host seconds
    per device second.
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
        """Return the batch without its first n samples. n: smaller than the batch."""
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
        """Standard deviation (n, 3) of each corrected rate, rad/s, by `combined_std`.

        Includes noise, bias, flicker, scale and misalignment.
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
    """Return the standard deviation (n, 3) of corrected rates, rad/s, as the root of a sum of independent variances.

    variance = noise_std² + bias_std² + flicker_std² + (rate · scale_std)² + (across · cross_std)²

    rate (n, 3): rad/s. across: root of the sum of squares of the rates about the other two axes, rad/s.
    noise_std, bias_std, flicker_std: rad/s. scale_std, cross_std: without unit. Each standard deviation is (3,) for all
    samples, or (n, 3).
    """
    rate_var = rate.astype(float) ** 2
    across_var = rate_var.sum(axis=1, keepdims=True) - rate_var
    var = rate_var * scale_std.astype(float) ** 2 + across_var * cross_std.astype(float) ** 2
    var += noise_std.astype(float) ** 2 + bias_std.astype(float) ** 2 + flicker_std.astype(float) ** 2
    return np.asarray(np.sqrt(var), dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class BiasRevision:
    """Revised bias of past samples: m points, each at a sample, linear in time between points.

    A revision applies to the CorrectedBatches of the same device, boot and calibration.
    sequences (m,) uint64: sample numbers, rising. times_ns (m,) int64: host times of these samples, rising, ns since
    the Unix epoch. bias, bias_std (m, 3) float32: bias of the reading, and its standard deviation, rad/s, sensor frame.
    matrix (3, 3): calibration matrix in use, without unit. time_ns: when the revision was made, ns since the Unix
    epoch.
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
    """Statistics of readings and corrected rates in m windows of window_s device seconds each, for display.

    sequences (m,) uint64: number of each window's last sample. times_ns (m,) int64: host time of that sample, ns since
    the Unix epoch. samples (m,) uint32: number of samples per window. flags (m,) uint32: SampleFlag bits of all its
    samples.
    reading_…, rate_… (m, 3) float32: mean, standard deviation, minimum and maximum, rad/s, sensor frame.
    bias, noise_std, bias_std, flicker_std (3,) float32: rad/s. scale_std, cross_std (3,) float32: without unit. These
    fields, quality and calibration are those of the CorrectedBatch of the last sample.
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

        The noise variance is divided by the number of samples; the other error variances stay.
        """
        noise = self.noise_std / np.sqrt(self.samples.astype(float))[:, None]
        return combined_std(self.rate_mean, noise, self.bias_std, self.scale_std, self.cross_std, self.flicker_std)
