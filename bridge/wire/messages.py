"""The messages as the program sees them: frozen, validated by the codec, arrays instead of lists.

All rates are rad/s, accelerations m/s², times seconds unless the name says otherwise; vectors are in the sensor frame.
Arrays are read-only by convention: nobody writes into a message.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import IntEnum, IntFlag
from typing import NamedTuple, TypeVar, dataclass_transform

import numpy as np
from numpy.typing import NDArray

from bridge.reasons.codes import Sentences

VERSION = 1
Floats = NDArray[np.float64]
T = TypeVar("T")
#: (3,) rad/s, the flicker of who says none
STEADY = np.zeros(3, np.float32)


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def _frequent(*, eq: bool) -> Callable[[type[T]], type[T]]:
    """A frozen dataclass to whoever checks types, and to nobody else: to make one that refuses takes eight times as long."""
    return dataclass(slots=True, eq=eq)


class SampleFlag(IntFlag):
    """Bits of `flags`; see the .proto for what each means."""

    OK = 0
    AFTER_GAP = 1
    CLIPPED = 2
    STUCK = 4
    LATE = 8
    TEMPERATURE_STEP = 16


class BootCause(IntEnum):
    """How the bridge knows of a boot."""

    UNKNOWN = 0
    POWER_UP = 1
    PORT_OPENED = 2


class Quality(IntEnum):
    """How far a corrected rate can be trusted."""

    NONE = 0
    PRIOR = 1
    BIAS_ONLY = 2
    GOOD = 3
    DEGRADED = 4


class State(IntEnum):
    """Where a device is in its life."""

    UNKNOWN = 0
    WARMING = 1
    AWAITING_STILL = 2
    BIAS_ONLY = 3
    TURNING = 4
    TRACKING = 5
    DEGRADED = 6
    LOST = 7


class Verdict(IntEnum):
    """The outcome of a calibration."""

    UNKNOWN = 0
    ACCEPTED = 1
    REPEAT = 2
    REFUSED = 3


@_frequent(eq=False)
class SampleBatch:
    """One run of n consecutive samples of one boot.

    ticks (n,) uint64 device time in ticks; gyro (n, 3) float32; accel (n, 3) float32 or None;
    temperature_c (n,) float32 or None; flags (n,) uint32. `bridge` is who published it, from the key.
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

    def __len__(self) -> int:
        return len(self.ticks)

    @property
    def device_time(self) -> Floats:
        """(n,) device seconds of each sample, since the device's own zero."""
        return np.asarray(self.ticks * self.tick_period_s, dtype=np.float64)

    @property
    def sample_time_ns(self) -> NDArray[np.int64]:
        """(n,) host time of each sample, nanoseconds since the Unix epoch."""
        return _host_ns(self)

    def after(self, n: int) -> "SampleBatch":
        """The batch without its first n samples."""
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


@_frequent(eq=False)
class CorrectedBatch:
    """Corrected rates of one SampleBatch: rate (n, 3) float32; the deviations, and bias, (3,) float32.

    bias_std is of the bias on the mean of minutes, flicker_std of what it flickers by about that.
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
    epoch: int = 0  # since when its estimator has the device: the higher, the later; 0 when not said
    flicker_std: NDArray[np.float32] = field(default_factory=lambda: STEADY)

    def __len__(self) -> int:
        return len(self.ticks)

    @property
    def device_time(self) -> Floats:
        """(n,) device seconds of each sample, since the device's own zero."""
        return np.asarray(self.ticks * self.tick_period_s, dtype=np.float64)

    @property
    def sample_time_ns(self) -> NDArray[np.int64]:
        """(n,) host time of each sample, nanoseconds since the Unix epoch."""
        return _host_ns(self)

    def after(self, n: int) -> "CorrectedBatch":
        """The batch without its first n samples."""
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
        """(n, 3) standard deviation of each corrected rate: noise, bias and its flicker, scale and misalignment together."""
        return rate_std(self.rate, self.noise_std, self.bias_std, self.scale_std, self.cross_std, self.flicker_std)


def _host_ns(batch: SampleBatch | CorrectedBatch) -> NDArray[np.int64]:
    since_first = (batch.ticks - batch.ticks[0]) * (batch.tick_period_s * batch.clock_rate * 1e9)
    return np.asarray(np.rint(since_first).astype(np.int64) + batch.start_time_ns, dtype=np.int64)


def rate_std(
    rate: NDArray[np.floating],
    noise_std: NDArray[np.floating],
    bias_std: NDArray[np.floating],
    scale_std: NDArray[np.floating],
    cross_std: NDArray[np.floating],
    flicker_std: NDArray[np.floating],
) -> Floats:
    """(n, 3) standard deviation of corrected rates (n, 3), from those of a CorrectedBatch: (3,), or (n, 3) each its own."""
    rate_var = rate.astype(float) ** 2
    across_var = rate_var.sum(axis=1, keepdims=True) - rate_var
    var = rate_var * scale_std.astype(float) ** 2 + across_var * cross_std.astype(float) ** 2
    var += noise_std.astype(float) ** 2 + bias_std.astype(float) ** 2 + flicker_std.astype(float) ** 2
    return np.asarray(np.sqrt(var), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class DeviceInfo:
    """What a device is and what its bridge saw of it."""

    device: str
    bridge: str
    boot: int
    boot_cause: BootCause
    model: str
    firmware: str
    driver: str
    port: str
    rate_hz: float
    measured_rate_hz: float
    gyro_range: float
    has_accel: bool
    has_temperature: bool
    time_ns: int
    samples: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    events: dict[str, int] = field(default_factory=dict)
    trouble: Sentences = ()  # what keeps it from being read; empty when all is well
    battery_percent: float = math.nan  # NaN when unknown
    charging: bool = False
    notices: Sentences = ()  # what a person should know of the device
    has_clock: bool = True  # its ticks are its own time, not made by the bridge of the count of its samples


#: age of the evidence of a device of which no rest is known
NO_REST_S = 1e12


@_frequent(eq=True)
class Status:
    """Where a device is in its life, and why. Vectors are tuples of three."""

    device: str
    boot: int
    time_ns: int
    state: State
    quality: Quality
    reason: Sentences
    progress: float
    axes_done: tuple[int, ...]
    bias: tuple[float, ...]
    bias_std: tuple[float, ...]
    scale: tuple[float, ...]
    calibration: str
    calibrated_time_ns: int
    evidence_age_s: float  # NO_REST_S when no rest is known in this boot
    temperature_c: float
    rate_hz: float
    samples_in: int
    samples_out: int
    dropped: dict[str, int] = field(default_factory=dict)
    events: dict[str, int] = field(default_factory=dict)
    bridge: str = ""  # whose samples of it are taken
    refused_bridges: tuple[str, ...] = ()  # others that send it now as well
    epoch: int = 0  # as in CorrectedBatch


@dataclass(frozen=True, slots=True)
class Turn:
    """One turn of a calibration: axis 0 x, 1 y, 2 z; angle and closure error in rad, corrected."""

    axis: int
    angle: float
    closure_error: float
    duration_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """corrected = matrix (reading - bias): matrix (3, 3), bias (3,) rad/s, covariance (p, p) of the p `parameters`."""

    device: str
    boot: int
    id: str
    time_ns: int
    method: str
    verdict: Verdict
    reason: Sentences
    matrix: Floats
    bias: Floats
    parameters: tuple[str, ...]
    covariance: Floats
    turns: tuple[Turn, ...]
    noise_std: Floats
    model: str
    firmware: str
    gyro_range: float
    rate_hz: float
    temperature_c: float
    who: str
    epoch: int = 0  # as in CorrectedBatch


@dataclass(frozen=True, slots=True, eq=False)
class BiasRevision:
    """The bias of past samples, known better now: m points, each a sample; between them it is linear in time.

    It covers the CorrectedBatches of the same device, boot and calibration. matrix (3, 3), the one in use;
    sequences (m,) uint64 and times_ns (m,) int64, host time, both rising; bias and bias_std (m, 3) float32 rad/s, of the reading.
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
    """What samples were like in m windows of window_s device seconds: for who looks at a device.

    sequences (m,) uint64 and times_ns (m,) int64, host time: of each window's last sample; samples (m,) how many there are in
    it; flags (m,) uint32 of any of them. reading_… and rate_… (m, 3) float32 rad/s: of readings and corrected rates. The
    others as in the CorrectedBatch of the last sample.
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
        """(m, 3) standard deviation of each mean corrected rate: noise lessens with the samples, the other errors do not."""
        noise = self.noise_std / np.sqrt(self.samples.astype(float))[:, None]
        return rate_std(self.rate_mean, noise, self.bias_std, self.scale_std, self.cross_std, self.flicker_std)


class Holding(NamedTuple):  # by the hundred, five times a second
    """A device that an estimator has since `epoch`; samples of this boot numbered below `next` are corrected and said.

    busy: turns of a calibration under way would be lost if another took it now.
    """

    device: str
    epoch: int
    boot: int
    next: int
    busy: bool = False


@dataclass(frozen=True, slots=True)
class Move:
    """When so many devices came to an estimator or left it, and why."""

    time_ns: int
    came: int
    left: int
    reason: Sentences


@dataclass(frozen=True, slots=True)
class Owned:
    """What an estimator has of the ward, or one of `parts` of it. load: processor seconds a second, of its process."""

    estimator: str
    time_ns: int
    epoch: int  # the highest it has heard of or has used
    load: float
    holdings: tuple[Holding, ...]
    moves: tuple[Move, ...] = ()
    part: int = 0
    parts: int = 1


@dataclass(frozen=True, slots=True, eq=False)
class Checkpoint:
    """What another estimator needs to go on with a device."""

    device: str
    boot: int
    epoch: int
    time_ns: int
    bridge: str = ""  # whose samples of it are taken
    calibration: Calibration | None = None  # in use: of this boot, or of an earlier one
    answers: tuple[tuple[str, "CommandReply"], ...] = ()  # verbs of the last few commands, and what they were answered
    boot_repeated: bool = False  # another power-up had this number, too, and this one is not calibrated yet
    state: bytes = b""  # of the session: see DeviceSession.restored


@dataclass(frozen=True, slots=True)
class Note:
    """A moment somebody marked, and what they wrote of a device."""

    device: str
    boot: int
    time_ns: int
    who: str
    text: str


@dataclass(frozen=True, slots=True)
class Command:
    """A request from a person or a program; the key names the verb."""

    request_id: str
    who: str
    reason: str


@dataclass(frozen=True, slots=True)
class CommandReply:
    """What became of a command; `message` says why."""

    request_id: str
    accepted: bool
    message: Sentences
