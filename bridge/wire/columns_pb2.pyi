from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Optional as _Optional

DESCRIPTOR: _descriptor.FileDescriptor

class SampleBatch(_message.Message):
    __slots__ = ("version", "device", "boot", "sequence", "receive_time_ns", "start_time_ns", "tick_period_s", "clock_rate", "ticks", "gyro", "accel", "temperature_c", "flags")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    BOOT_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    RECEIVE_TIME_NS_FIELD_NUMBER: _ClassVar[int]
    START_TIME_NS_FIELD_NUMBER: _ClassVar[int]
    TICK_PERIOD_S_FIELD_NUMBER: _ClassVar[int]
    CLOCK_RATE_FIELD_NUMBER: _ClassVar[int]
    TICKS_FIELD_NUMBER: _ClassVar[int]
    GYRO_FIELD_NUMBER: _ClassVar[int]
    ACCEL_FIELD_NUMBER: _ClassVar[int]
    TEMPERATURE_C_FIELD_NUMBER: _ClassVar[int]
    FLAGS_FIELD_NUMBER: _ClassVar[int]
    version: int
    device: str
    boot: int
    sequence: int
    receive_time_ns: int
    start_time_ns: int
    tick_period_s: float
    clock_rate: float
    ticks: bytes
    gyro: bytes
    accel: bytes
    temperature_c: bytes
    flags: bytes
    def __init__(self, version: _Optional[int] = ..., device: _Optional[str] = ..., boot: _Optional[int] = ..., sequence: _Optional[int] = ..., receive_time_ns: _Optional[int] = ..., start_time_ns: _Optional[int] = ..., tick_period_s: _Optional[float] = ..., clock_rate: _Optional[float] = ..., ticks: _Optional[bytes] = ..., gyro: _Optional[bytes] = ..., accel: _Optional[bytes] = ..., temperature_c: _Optional[bytes] = ..., flags: _Optional[bytes] = ...) -> None: ...

class CorrectedBatch(_message.Message):
    __slots__ = ("version", "device", "boot", "sequence", "start_time_ns", "tick_period_s", "clock_rate", "ticks", "rate", "flags", "quality", "noise_std", "bias_std", "scale_std", "bias", "calibration", "cross_std", "epoch", "flicker_std")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    BOOT_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    START_TIME_NS_FIELD_NUMBER: _ClassVar[int]
    TICK_PERIOD_S_FIELD_NUMBER: _ClassVar[int]
    CLOCK_RATE_FIELD_NUMBER: _ClassVar[int]
    TICKS_FIELD_NUMBER: _ClassVar[int]
    RATE_FIELD_NUMBER: _ClassVar[int]
    FLAGS_FIELD_NUMBER: _ClassVar[int]
    QUALITY_FIELD_NUMBER: _ClassVar[int]
    NOISE_STD_FIELD_NUMBER: _ClassVar[int]
    BIAS_STD_FIELD_NUMBER: _ClassVar[int]
    SCALE_STD_FIELD_NUMBER: _ClassVar[int]
    BIAS_FIELD_NUMBER: _ClassVar[int]
    CALIBRATION_FIELD_NUMBER: _ClassVar[int]
    CROSS_STD_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    FLICKER_STD_FIELD_NUMBER: _ClassVar[int]
    version: int
    device: str
    boot: int
    sequence: int
    start_time_ns: int
    tick_period_s: float
    clock_rate: float
    ticks: bytes
    rate: bytes
    flags: bytes
    quality: int
    noise_std: bytes
    bias_std: bytes
    scale_std: bytes
    bias: bytes
    calibration: str
    cross_std: bytes
    epoch: int
    flicker_std: bytes
    def __init__(self, version: _Optional[int] = ..., device: _Optional[str] = ..., boot: _Optional[int] = ..., sequence: _Optional[int] = ..., start_time_ns: _Optional[int] = ..., tick_period_s: _Optional[float] = ..., clock_rate: _Optional[float] = ..., ticks: _Optional[bytes] = ..., rate: _Optional[bytes] = ..., flags: _Optional[bytes] = ..., quality: _Optional[int] = ..., noise_std: _Optional[bytes] = ..., bias_std: _Optional[bytes] = ..., scale_std: _Optional[bytes] = ..., bias: _Optional[bytes] = ..., calibration: _Optional[str] = ..., cross_std: _Optional[bytes] = ..., epoch: _Optional[int] = ..., flicker_std: _Optional[bytes] = ...) -> None: ...

class WindowBatch(_message.Message):
    __slots__ = ("version", "device", "boot", "window_s", "sequences", "times_ns", "samples", "flags", "reading_mean", "reading_std", "reading_min", "reading_max", "rate_mean", "rate_std", "rate_min", "rate_max", "quality", "noise_std", "bias_std", "scale_std", "cross_std", "bias", "calibration", "flicker_std")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    BOOT_FIELD_NUMBER: _ClassVar[int]
    WINDOW_S_FIELD_NUMBER: _ClassVar[int]
    SEQUENCES_FIELD_NUMBER: _ClassVar[int]
    TIMES_NS_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_FIELD_NUMBER: _ClassVar[int]
    FLAGS_FIELD_NUMBER: _ClassVar[int]
    READING_MEAN_FIELD_NUMBER: _ClassVar[int]
    READING_STD_FIELD_NUMBER: _ClassVar[int]
    READING_MIN_FIELD_NUMBER: _ClassVar[int]
    READING_MAX_FIELD_NUMBER: _ClassVar[int]
    RATE_MEAN_FIELD_NUMBER: _ClassVar[int]
    RATE_STD_FIELD_NUMBER: _ClassVar[int]
    RATE_MIN_FIELD_NUMBER: _ClassVar[int]
    RATE_MAX_FIELD_NUMBER: _ClassVar[int]
    QUALITY_FIELD_NUMBER: _ClassVar[int]
    NOISE_STD_FIELD_NUMBER: _ClassVar[int]
    BIAS_STD_FIELD_NUMBER: _ClassVar[int]
    SCALE_STD_FIELD_NUMBER: _ClassVar[int]
    CROSS_STD_FIELD_NUMBER: _ClassVar[int]
    BIAS_FIELD_NUMBER: _ClassVar[int]
    CALIBRATION_FIELD_NUMBER: _ClassVar[int]
    FLICKER_STD_FIELD_NUMBER: _ClassVar[int]
    version: int
    device: str
    boot: int
    window_s: float
    sequences: bytes
    times_ns: bytes
    samples: bytes
    flags: bytes
    reading_mean: bytes
    reading_std: bytes
    reading_min: bytes
    reading_max: bytes
    rate_mean: bytes
    rate_std: bytes
    rate_min: bytes
    rate_max: bytes
    quality: int
    noise_std: bytes
    bias_std: bytes
    scale_std: bytes
    cross_std: bytes
    bias: bytes
    calibration: str
    flicker_std: bytes
    def __init__(self, version: _Optional[int] = ..., device: _Optional[str] = ..., boot: _Optional[int] = ..., window_s: _Optional[float] = ..., sequences: _Optional[bytes] = ..., times_ns: _Optional[bytes] = ..., samples: _Optional[bytes] = ..., flags: _Optional[bytes] = ..., reading_mean: _Optional[bytes] = ..., reading_std: _Optional[bytes] = ..., reading_min: _Optional[bytes] = ..., reading_max: _Optional[bytes] = ..., rate_mean: _Optional[bytes] = ..., rate_std: _Optional[bytes] = ..., rate_min: _Optional[bytes] = ..., rate_max: _Optional[bytes] = ..., quality: _Optional[int] = ..., noise_std: _Optional[bytes] = ..., bias_std: _Optional[bytes] = ..., scale_std: _Optional[bytes] = ..., cross_std: _Optional[bytes] = ..., bias: _Optional[bytes] = ..., calibration: _Optional[str] = ..., flicker_std: _Optional[bytes] = ...) -> None: ...

class OrientationBatch(_message.Message):
    __slots__ = ("version", "device", "boot", "sequence", "start_time_ns", "tick_period_s", "clock_rate", "ticks", "quat_wxyz", "linear_accel", "covariance", "zero_sequence", "zero", "quality", "epoch")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    BOOT_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    START_TIME_NS_FIELD_NUMBER: _ClassVar[int]
    TICK_PERIOD_S_FIELD_NUMBER: _ClassVar[int]
    CLOCK_RATE_FIELD_NUMBER: _ClassVar[int]
    TICKS_FIELD_NUMBER: _ClassVar[int]
    QUAT_WXYZ_FIELD_NUMBER: _ClassVar[int]
    LINEAR_ACCEL_FIELD_NUMBER: _ClassVar[int]
    COVARIANCE_FIELD_NUMBER: _ClassVar[int]
    ZERO_SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    ZERO_FIELD_NUMBER: _ClassVar[int]
    QUALITY_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    version: int
    device: str
    boot: int
    sequence: int
    start_time_ns: int
    tick_period_s: float
    clock_rate: float
    ticks: bytes
    quat_wxyz: bytes
    linear_accel: bytes
    covariance: bytes
    zero_sequence: int
    zero: str
    quality: int
    epoch: int
    def __init__(self, version: _Optional[int] = ..., device: _Optional[str] = ..., boot: _Optional[int] = ..., sequence: _Optional[int] = ..., start_time_ns: _Optional[int] = ..., tick_period_s: _Optional[float] = ..., clock_rate: _Optional[float] = ..., ticks: _Optional[bytes] = ..., quat_wxyz: _Optional[bytes] = ..., linear_accel: _Optional[bytes] = ..., covariance: _Optional[bytes] = ..., zero_sequence: _Optional[int] = ..., zero: _Optional[str] = ..., quality: _Optional[int] = ..., epoch: _Optional[int] = ...) -> None: ...
