from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class SampleFlag(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    SAMPLE_OK: _ClassVar[SampleFlag]
    SAMPLE_AFTER_GAP: _ClassVar[SampleFlag]
    SAMPLE_CLIPPED: _ClassVar[SampleFlag]
    SAMPLE_STUCK: _ClassVar[SampleFlag]
    SAMPLE_LATE: _ClassVar[SampleFlag]
    SAMPLE_TEMPERATURE_STEP: _ClassVar[SampleFlag]

class BootCause(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    BOOT_UNKNOWN: _ClassVar[BootCause]
    BOOT_POWER_UP: _ClassVar[BootCause]
    BOOT_PORT_OPENED: _ClassVar[BootCause]

class Quality(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    QUALITY_NONE: _ClassVar[Quality]
    QUALITY_PRIOR: _ClassVar[Quality]
    QUALITY_BIAS_ONLY: _ClassVar[Quality]
    QUALITY_GOOD: _ClassVar[Quality]
    QUALITY_DEGRADED: _ClassVar[Quality]

class State(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    STATE_UNKNOWN: _ClassVar[State]
    STATE_WARMING: _ClassVar[State]
    STATE_AWAITING_STILL: _ClassVar[State]
    STATE_BIAS_ONLY: _ClassVar[State]
    STATE_TURNING: _ClassVar[State]
    STATE_TRACKING: _ClassVar[State]
    STATE_DEGRADED: _ClassVar[State]
    STATE_LOST: _ClassVar[State]

class Verdict(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    VERDICT_UNKNOWN: _ClassVar[Verdict]
    VERDICT_ACCEPTED: _ClassVar[Verdict]
    VERDICT_REPEAT: _ClassVar[Verdict]
    VERDICT_REFUSED: _ClassVar[Verdict]
SAMPLE_OK: SampleFlag
SAMPLE_AFTER_GAP: SampleFlag
SAMPLE_CLIPPED: SampleFlag
SAMPLE_STUCK: SampleFlag
SAMPLE_LATE: SampleFlag
SAMPLE_TEMPERATURE_STEP: SampleFlag
BOOT_UNKNOWN: BootCause
BOOT_POWER_UP: BootCause
BOOT_PORT_OPENED: BootCause
QUALITY_NONE: Quality
QUALITY_PRIOR: Quality
QUALITY_BIAS_ONLY: Quality
QUALITY_GOOD: Quality
QUALITY_DEGRADED: Quality
STATE_UNKNOWN: State
STATE_WARMING: State
STATE_AWAITING_STILL: State
STATE_BIAS_ONLY: State
STATE_TURNING: State
STATE_TRACKING: State
STATE_DEGRADED: State
STATE_LOST: State
VERDICT_UNKNOWN: Verdict
VERDICT_ACCEPTED: Verdict
VERDICT_REPEAT: Verdict
VERDICT_REFUSED: Verdict

class Sentence(_message.Message):
    __slots__ = ("code", "params")
    class ParamsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    CODE_FIELD_NUMBER: _ClassVar[int]
    PARAMS_FIELD_NUMBER: _ClassVar[int]
    code: str
    params: _containers.ScalarMap[str, str]
    def __init__(self, code: _Optional[str] = ..., params: _Optional[_Mapping[str, str]] = ...) -> None: ...

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
    ticks: _containers.RepeatedScalarFieldContainer[int]
    gyro: _containers.RepeatedScalarFieldContainer[float]
    accel: _containers.RepeatedScalarFieldContainer[float]
    temperature_c: _containers.RepeatedScalarFieldContainer[float]
    flags: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, version: _Optional[int] = ..., device: _Optional[str] = ..., boot: _Optional[int] = ..., sequence: _Optional[int] = ..., receive_time_ns: _Optional[int] = ..., start_time_ns: _Optional[int] = ..., tick_period_s: _Optional[float] = ..., clock_rate: _Optional[float] = ..., ticks: _Optional[_Iterable[int]] = ..., gyro: _Optional[_Iterable[float]] = ..., accel: _Optional[_Iterable[float]] = ..., temperature_c: _Optional[_Iterable[float]] = ..., flags: _Optional[_Iterable[int]] = ...) -> None: ...

class DeviceInfo(_message.Message):
    __slots__ = ("version", "device", "bridge", "boot", "boot_cause", "model", "firmware", "driver", "port", "rate_hz", "measured_rate_hz", "gyro_range", "has_accel", "has_temperature", "time_ns", "samples", "dropped", "events", "trouble", "battery_percent", "charging", "notices", "has_clock", "calibration")
    class DroppedEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: int
        def __init__(self, key: _Optional[str] = ..., value: _Optional[int] = ...) -> None: ...
    class EventsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: int
        def __init__(self, key: _Optional[str] = ..., value: _Optional[int] = ...) -> None: ...
    VERSION_FIELD_NUMBER: _ClassVar[int]
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    BRIDGE_FIELD_NUMBER: _ClassVar[int]
    BOOT_FIELD_NUMBER: _ClassVar[int]
    BOOT_CAUSE_FIELD_NUMBER: _ClassVar[int]
    MODEL_FIELD_NUMBER: _ClassVar[int]
    FIRMWARE_FIELD_NUMBER: _ClassVar[int]
    DRIVER_FIELD_NUMBER: _ClassVar[int]
    PORT_FIELD_NUMBER: _ClassVar[int]
    RATE_HZ_FIELD_NUMBER: _ClassVar[int]
    MEASURED_RATE_HZ_FIELD_NUMBER: _ClassVar[int]
    GYRO_RANGE_FIELD_NUMBER: _ClassVar[int]
    HAS_ACCEL_FIELD_NUMBER: _ClassVar[int]
    HAS_TEMPERATURE_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_FIELD_NUMBER: _ClassVar[int]
    DROPPED_FIELD_NUMBER: _ClassVar[int]
    EVENTS_FIELD_NUMBER: _ClassVar[int]
    TROUBLE_FIELD_NUMBER: _ClassVar[int]
    BATTERY_PERCENT_FIELD_NUMBER: _ClassVar[int]
    CHARGING_FIELD_NUMBER: _ClassVar[int]
    NOTICES_FIELD_NUMBER: _ClassVar[int]
    HAS_CLOCK_FIELD_NUMBER: _ClassVar[int]
    CALIBRATION_FIELD_NUMBER: _ClassVar[int]
    version: int
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
    samples: int
    dropped: _containers.ScalarMap[str, int]
    events: _containers.ScalarMap[str, int]
    trouble: _containers.RepeatedCompositeFieldContainer[Sentence]
    battery_percent: float
    charging: bool
    notices: _containers.RepeatedCompositeFieldContainer[Sentence]
    has_clock: bool
    calibration: DeviceCalibration
    def __init__(self, version: _Optional[int] = ..., device: _Optional[str] = ..., bridge: _Optional[str] = ..., boot: _Optional[int] = ..., boot_cause: _Optional[_Union[BootCause, str]] = ..., model: _Optional[str] = ..., firmware: _Optional[str] = ..., driver: _Optional[str] = ..., port: _Optional[str] = ..., rate_hz: _Optional[float] = ..., measured_rate_hz: _Optional[float] = ..., gyro_range: _Optional[float] = ..., has_accel: _Optional[bool] = ..., has_temperature: _Optional[bool] = ..., time_ns: _Optional[int] = ..., samples: _Optional[int] = ..., dropped: _Optional[_Mapping[str, int]] = ..., events: _Optional[_Mapping[str, int]] = ..., trouble: _Optional[_Iterable[_Union[Sentence, _Mapping]]] = ..., battery_percent: _Optional[float] = ..., charging: _Optional[bool] = ..., notices: _Optional[_Iterable[_Union[Sentence, _Mapping]]] = ..., has_clock: _Optional[bool] = ..., calibration: _Optional[_Union[DeviceCalibration, _Mapping]] = ...) -> None: ...

class DeviceCalibration(_message.Message):
    __slots__ = ("boot", "sequence", "scale", "bias")
    BOOT_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    SCALE_FIELD_NUMBER: _ClassVar[int]
    BIAS_FIELD_NUMBER: _ClassVar[int]
    boot: int
    sequence: int
    scale: _containers.RepeatedScalarFieldContainer[float]
    bias: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, boot: _Optional[int] = ..., sequence: _Optional[int] = ..., scale: _Optional[_Iterable[float]] = ..., bias: _Optional[_Iterable[float]] = ...) -> None: ...

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
    ticks: _containers.RepeatedScalarFieldContainer[int]
    rate: _containers.RepeatedScalarFieldContainer[float]
    flags: _containers.RepeatedScalarFieldContainer[int]
    quality: Quality
    noise_std: _containers.RepeatedScalarFieldContainer[float]
    bias_std: _containers.RepeatedScalarFieldContainer[float]
    scale_std: _containers.RepeatedScalarFieldContainer[float]
    bias: _containers.RepeatedScalarFieldContainer[float]
    calibration: str
    cross_std: _containers.RepeatedScalarFieldContainer[float]
    epoch: int
    flicker_std: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, version: _Optional[int] = ..., device: _Optional[str] = ..., boot: _Optional[int] = ..., sequence: _Optional[int] = ..., start_time_ns: _Optional[int] = ..., tick_period_s: _Optional[float] = ..., clock_rate: _Optional[float] = ..., ticks: _Optional[_Iterable[int]] = ..., rate: _Optional[_Iterable[float]] = ..., flags: _Optional[_Iterable[int]] = ..., quality: _Optional[_Union[Quality, str]] = ..., noise_std: _Optional[_Iterable[float]] = ..., bias_std: _Optional[_Iterable[float]] = ..., scale_std: _Optional[_Iterable[float]] = ..., bias: _Optional[_Iterable[float]] = ..., calibration: _Optional[str] = ..., cross_std: _Optional[_Iterable[float]] = ..., epoch: _Optional[int] = ..., flicker_std: _Optional[_Iterable[float]] = ...) -> None: ...

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
    ticks: _containers.RepeatedScalarFieldContainer[int]
    quat_wxyz: _containers.RepeatedScalarFieldContainer[float]
    linear_accel: _containers.RepeatedScalarFieldContainer[float]
    covariance: _containers.RepeatedScalarFieldContainer[float]
    zero_sequence: int
    zero: str
    quality: Quality
    epoch: int
    def __init__(self, version: _Optional[int] = ..., device: _Optional[str] = ..., boot: _Optional[int] = ..., sequence: _Optional[int] = ..., start_time_ns: _Optional[int] = ..., tick_period_s: _Optional[float] = ..., clock_rate: _Optional[float] = ..., ticks: _Optional[_Iterable[int]] = ..., quat_wxyz: _Optional[_Iterable[float]] = ..., linear_accel: _Optional[_Iterable[float]] = ..., covariance: _Optional[_Iterable[float]] = ..., zero_sequence: _Optional[int] = ..., zero: _Optional[str] = ..., quality: _Optional[_Union[Quality, str]] = ..., epoch: _Optional[int] = ...) -> None: ...

class Status(_message.Message):
    __slots__ = ("version", "device", "boot", "time_ns", "state", "quality", "reason", "progress", "axes_done", "bias", "bias_std", "scale", "calibration", "calibrated_time_ns", "evidence_age_s", "temperature_c", "rate_hz", "samples_in", "samples_out", "dropped", "events", "bridge", "refused_bridges", "epoch", "placement", "alerts", "accelerometer", "nis", "receipts")
    class DroppedEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: int
        def __init__(self, key: _Optional[str] = ..., value: _Optional[int] = ...) -> None: ...
    class EventsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: int
        def __init__(self, key: _Optional[str] = ..., value: _Optional[int] = ...) -> None: ...
    VERSION_FIELD_NUMBER: _ClassVar[int]
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    BOOT_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    QUALITY_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    PROGRESS_FIELD_NUMBER: _ClassVar[int]
    AXES_DONE_FIELD_NUMBER: _ClassVar[int]
    BIAS_FIELD_NUMBER: _ClassVar[int]
    BIAS_STD_FIELD_NUMBER: _ClassVar[int]
    SCALE_FIELD_NUMBER: _ClassVar[int]
    CALIBRATION_FIELD_NUMBER: _ClassVar[int]
    CALIBRATED_TIME_NS_FIELD_NUMBER: _ClassVar[int]
    EVIDENCE_AGE_S_FIELD_NUMBER: _ClassVar[int]
    TEMPERATURE_C_FIELD_NUMBER: _ClassVar[int]
    RATE_HZ_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_IN_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_OUT_FIELD_NUMBER: _ClassVar[int]
    DROPPED_FIELD_NUMBER: _ClassVar[int]
    EVENTS_FIELD_NUMBER: _ClassVar[int]
    BRIDGE_FIELD_NUMBER: _ClassVar[int]
    REFUSED_BRIDGES_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    PLACEMENT_FIELD_NUMBER: _ClassVar[int]
    ALERTS_FIELD_NUMBER: _ClassVar[int]
    ACCELEROMETER_FIELD_NUMBER: _ClassVar[int]
    NIS_FIELD_NUMBER: _ClassVar[int]
    RECEIPTS_FIELD_NUMBER: _ClassVar[int]
    version: int
    device: str
    boot: int
    time_ns: int
    state: State
    quality: Quality
    reason: _containers.RepeatedCompositeFieldContainer[Sentence]
    progress: float
    axes_done: _containers.RepeatedScalarFieldContainer[int]
    bias: _containers.RepeatedScalarFieldContainer[float]
    bias_std: _containers.RepeatedScalarFieldContainer[float]
    scale: _containers.RepeatedScalarFieldContainer[float]
    calibration: str
    calibrated_time_ns: int
    evidence_age_s: float
    temperature_c: float
    rate_hz: float
    samples_in: int
    samples_out: int
    dropped: _containers.ScalarMap[str, int]
    events: _containers.ScalarMap[str, int]
    bridge: str
    refused_bridges: _containers.RepeatedScalarFieldContainer[str]
    epoch: int
    placement: Placement
    alerts: _containers.RepeatedCompositeFieldContainer[Alert]
    accelerometer: AccelerometerCalibration
    nis: float
    receipts: _containers.RepeatedCompositeFieldContainer[Receipt]
    def __init__(self, version: _Optional[int] = ..., device: _Optional[str] = ..., boot: _Optional[int] = ..., time_ns: _Optional[int] = ..., state: _Optional[_Union[State, str]] = ..., quality: _Optional[_Union[Quality, str]] = ..., reason: _Optional[_Iterable[_Union[Sentence, _Mapping]]] = ..., progress: _Optional[float] = ..., axes_done: _Optional[_Iterable[int]] = ..., bias: _Optional[_Iterable[float]] = ..., bias_std: _Optional[_Iterable[float]] = ..., scale: _Optional[_Iterable[float]] = ..., calibration: _Optional[str] = ..., calibrated_time_ns: _Optional[int] = ..., evidence_age_s: _Optional[float] = ..., temperature_c: _Optional[float] = ..., rate_hz: _Optional[float] = ..., samples_in: _Optional[int] = ..., samples_out: _Optional[int] = ..., dropped: _Optional[_Mapping[str, int]] = ..., events: _Optional[_Mapping[str, int]] = ..., bridge: _Optional[str] = ..., refused_bridges: _Optional[_Iterable[str]] = ..., epoch: _Optional[int] = ..., placement: _Optional[_Union[Placement, _Mapping]] = ..., alerts: _Optional[_Iterable[_Union[Alert, _Mapping]]] = ..., accelerometer: _Optional[_Union[AccelerometerCalibration, _Mapping]] = ..., nis: _Optional[float] = ..., receipts: _Optional[_Iterable[_Union[Receipt, _Mapping]]] = ...) -> None: ...

class AccelerometerCalibration(_message.Message):
    __slots__ = ("verdict", "reason", "poses", "bias", "scale", "covariance", "cross_std")
    VERDICT_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    POSES_FIELD_NUMBER: _ClassVar[int]
    BIAS_FIELD_NUMBER: _ClassVar[int]
    SCALE_FIELD_NUMBER: _ClassVar[int]
    COVARIANCE_FIELD_NUMBER: _ClassVar[int]
    CROSS_STD_FIELD_NUMBER: _ClassVar[int]
    verdict: Verdict
    reason: _containers.RepeatedCompositeFieldContainer[Sentence]
    poses: int
    bias: _containers.RepeatedScalarFieldContainer[float]
    scale: _containers.RepeatedScalarFieldContainer[float]
    covariance: _containers.RepeatedScalarFieldContainer[float]
    cross_std: float
    def __init__(self, verdict: _Optional[_Union[Verdict, str]] = ..., reason: _Optional[_Iterable[_Union[Sentence, _Mapping]]] = ..., poses: _Optional[int] = ..., bias: _Optional[_Iterable[float]] = ..., scale: _Optional[_Iterable[float]] = ..., covariance: _Optional[_Iterable[float]] = ..., cross_std: _Optional[float] = ...) -> None: ...

class Receipt(_message.Message):
    __slots__ = ("time_ns", "kind", "innovation", "innovation_std", "nis", "test_ratio", "accepted", "reason")
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    INNOVATION_FIELD_NUMBER: _ClassVar[int]
    INNOVATION_STD_FIELD_NUMBER: _ClassVar[int]
    NIS_FIELD_NUMBER: _ClassVar[int]
    TEST_RATIO_FIELD_NUMBER: _ClassVar[int]
    ACCEPTED_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    time_ns: int
    kind: str
    innovation: _containers.RepeatedScalarFieldContainer[float]
    innovation_std: _containers.RepeatedScalarFieldContainer[float]
    nis: float
    test_ratio: float
    accepted: bool
    reason: str
    def __init__(self, time_ns: _Optional[int] = ..., kind: _Optional[str] = ..., innovation: _Optional[_Iterable[float]] = ..., innovation_std: _Optional[_Iterable[float]] = ..., nis: _Optional[float] = ..., test_ratio: _Optional[float] = ..., accepted: _Optional[bool] = ..., reason: _Optional[str] = ...) -> None: ...

class Placement(_message.Message):
    __slots__ = ("segment", "side", "wearer", "since_ns", "who")
    SEGMENT_FIELD_NUMBER: _ClassVar[int]
    SIDE_FIELD_NUMBER: _ClassVar[int]
    WEARER_FIELD_NUMBER: _ClassVar[int]
    SINCE_NS_FIELD_NUMBER: _ClassVar[int]
    WHO_FIELD_NUMBER: _ClassVar[int]
    segment: str
    side: str
    wearer: str
    since_ns: int
    who: str
    def __init__(self, segment: _Optional[str] = ..., side: _Optional[str] = ..., wearer: _Optional[str] = ..., since_ns: _Optional[int] = ..., who: _Optional[str] = ...) -> None: ...

class Alert(_message.Message):
    __slots__ = ("kind", "since_ns", "raised_ns", "acknowledged_ns", "who")
    KIND_FIELD_NUMBER: _ClassVar[int]
    SINCE_NS_FIELD_NUMBER: _ClassVar[int]
    RAISED_NS_FIELD_NUMBER: _ClassVar[int]
    ACKNOWLEDGED_NS_FIELD_NUMBER: _ClassVar[int]
    WHO_FIELD_NUMBER: _ClassVar[int]
    kind: str
    since_ns: int
    raised_ns: int
    acknowledged_ns: int
    who: str
    def __init__(self, kind: _Optional[str] = ..., since_ns: _Optional[int] = ..., raised_ns: _Optional[int] = ..., acknowledged_ns: _Optional[int] = ..., who: _Optional[str] = ...) -> None: ...

class Turn(_message.Message):
    __slots__ = ("axis", "angle", "closure_error", "duration_s")
    AXIS_FIELD_NUMBER: _ClassVar[int]
    ANGLE_FIELD_NUMBER: _ClassVar[int]
    CLOSURE_ERROR_FIELD_NUMBER: _ClassVar[int]
    DURATION_S_FIELD_NUMBER: _ClassVar[int]
    axis: int
    angle: float
    closure_error: float
    duration_s: float
    def __init__(self, axis: _Optional[int] = ..., angle: _Optional[float] = ..., closure_error: _Optional[float] = ..., duration_s: _Optional[float] = ...) -> None: ...

class Calibration(_message.Message):
    __slots__ = ("version", "device", "boot", "id", "time_ns", "method", "verdict", "reason", "matrix", "bias", "parameters", "covariance", "turns", "noise_std", "model", "firmware", "gyro_range", "rate_hz", "temperature_c", "who", "epoch", "accelerometer")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    BOOT_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    METHOD_FIELD_NUMBER: _ClassVar[int]
    VERDICT_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    MATRIX_FIELD_NUMBER: _ClassVar[int]
    BIAS_FIELD_NUMBER: _ClassVar[int]
    PARAMETERS_FIELD_NUMBER: _ClassVar[int]
    COVARIANCE_FIELD_NUMBER: _ClassVar[int]
    TURNS_FIELD_NUMBER: _ClassVar[int]
    NOISE_STD_FIELD_NUMBER: _ClassVar[int]
    MODEL_FIELD_NUMBER: _ClassVar[int]
    FIRMWARE_FIELD_NUMBER: _ClassVar[int]
    GYRO_RANGE_FIELD_NUMBER: _ClassVar[int]
    RATE_HZ_FIELD_NUMBER: _ClassVar[int]
    TEMPERATURE_C_FIELD_NUMBER: _ClassVar[int]
    WHO_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    ACCELEROMETER_FIELD_NUMBER: _ClassVar[int]
    version: int
    device: str
    boot: int
    id: str
    time_ns: int
    method: str
    verdict: Verdict
    reason: _containers.RepeatedCompositeFieldContainer[Sentence]
    matrix: _containers.RepeatedScalarFieldContainer[float]
    bias: _containers.RepeatedScalarFieldContainer[float]
    parameters: _containers.RepeatedScalarFieldContainer[str]
    covariance: _containers.RepeatedScalarFieldContainer[float]
    turns: _containers.RepeatedCompositeFieldContainer[Turn]
    noise_std: _containers.RepeatedScalarFieldContainer[float]
    model: str
    firmware: str
    gyro_range: float
    rate_hz: float
    temperature_c: float
    who: str
    epoch: int
    accelerometer: AccelerometerCalibration
    def __init__(self, version: _Optional[int] = ..., device: _Optional[str] = ..., boot: _Optional[int] = ..., id: _Optional[str] = ..., time_ns: _Optional[int] = ..., method: _Optional[str] = ..., verdict: _Optional[_Union[Verdict, str]] = ..., reason: _Optional[_Iterable[_Union[Sentence, _Mapping]]] = ..., matrix: _Optional[_Iterable[float]] = ..., bias: _Optional[_Iterable[float]] = ..., parameters: _Optional[_Iterable[str]] = ..., covariance: _Optional[_Iterable[float]] = ..., turns: _Optional[_Iterable[_Union[Turn, _Mapping]]] = ..., noise_std: _Optional[_Iterable[float]] = ..., model: _Optional[str] = ..., firmware: _Optional[str] = ..., gyro_range: _Optional[float] = ..., rate_hz: _Optional[float] = ..., temperature_c: _Optional[float] = ..., who: _Optional[str] = ..., epoch: _Optional[int] = ..., accelerometer: _Optional[_Union[AccelerometerCalibration, _Mapping]] = ...) -> None: ...

class BiasRevision(_message.Message):
    __slots__ = ("version", "device", "boot", "calibration", "time_ns", "matrix", "sequences", "times_ns", "bias", "bias_std", "reason")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    BOOT_FIELD_NUMBER: _ClassVar[int]
    CALIBRATION_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    MATRIX_FIELD_NUMBER: _ClassVar[int]
    SEQUENCES_FIELD_NUMBER: _ClassVar[int]
    TIMES_NS_FIELD_NUMBER: _ClassVar[int]
    BIAS_FIELD_NUMBER: _ClassVar[int]
    BIAS_STD_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    version: int
    device: str
    boot: int
    calibration: str
    time_ns: int
    matrix: _containers.RepeatedScalarFieldContainer[float]
    sequences: _containers.RepeatedScalarFieldContainer[int]
    times_ns: _containers.RepeatedScalarFieldContainer[int]
    bias: _containers.RepeatedScalarFieldContainer[float]
    bias_std: _containers.RepeatedScalarFieldContainer[float]
    reason: _containers.RepeatedCompositeFieldContainer[Sentence]
    def __init__(self, version: _Optional[int] = ..., device: _Optional[str] = ..., boot: _Optional[int] = ..., calibration: _Optional[str] = ..., time_ns: _Optional[int] = ..., matrix: _Optional[_Iterable[float]] = ..., sequences: _Optional[_Iterable[int]] = ..., times_ns: _Optional[_Iterable[int]] = ..., bias: _Optional[_Iterable[float]] = ..., bias_std: _Optional[_Iterable[float]] = ..., reason: _Optional[_Iterable[_Union[Sentence, _Mapping]]] = ...) -> None: ...

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
    sequences: _containers.RepeatedScalarFieldContainer[int]
    times_ns: _containers.RepeatedScalarFieldContainer[int]
    samples: _containers.RepeatedScalarFieldContainer[int]
    flags: _containers.RepeatedScalarFieldContainer[int]
    reading_mean: _containers.RepeatedScalarFieldContainer[float]
    reading_std: _containers.RepeatedScalarFieldContainer[float]
    reading_min: _containers.RepeatedScalarFieldContainer[float]
    reading_max: _containers.RepeatedScalarFieldContainer[float]
    rate_mean: _containers.RepeatedScalarFieldContainer[float]
    rate_std: _containers.RepeatedScalarFieldContainer[float]
    rate_min: _containers.RepeatedScalarFieldContainer[float]
    rate_max: _containers.RepeatedScalarFieldContainer[float]
    quality: Quality
    noise_std: _containers.RepeatedScalarFieldContainer[float]
    bias_std: _containers.RepeatedScalarFieldContainer[float]
    scale_std: _containers.RepeatedScalarFieldContainer[float]
    cross_std: _containers.RepeatedScalarFieldContainer[float]
    bias: _containers.RepeatedScalarFieldContainer[float]
    calibration: str
    flicker_std: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, version: _Optional[int] = ..., device: _Optional[str] = ..., boot: _Optional[int] = ..., window_s: _Optional[float] = ..., sequences: _Optional[_Iterable[int]] = ..., times_ns: _Optional[_Iterable[int]] = ..., samples: _Optional[_Iterable[int]] = ..., flags: _Optional[_Iterable[int]] = ..., reading_mean: _Optional[_Iterable[float]] = ..., reading_std: _Optional[_Iterable[float]] = ..., reading_min: _Optional[_Iterable[float]] = ..., reading_max: _Optional[_Iterable[float]] = ..., rate_mean: _Optional[_Iterable[float]] = ..., rate_std: _Optional[_Iterable[float]] = ..., rate_min: _Optional[_Iterable[float]] = ..., rate_max: _Optional[_Iterable[float]] = ..., quality: _Optional[_Union[Quality, str]] = ..., noise_std: _Optional[_Iterable[float]] = ..., bias_std: _Optional[_Iterable[float]] = ..., scale_std: _Optional[_Iterable[float]] = ..., cross_std: _Optional[_Iterable[float]] = ..., bias: _Optional[_Iterable[float]] = ..., calibration: _Optional[str] = ..., flicker_std: _Optional[_Iterable[float]] = ...) -> None: ...

class Owned(_message.Message):
    __slots__ = ("version", "estimator", "time_ns", "epoch", "load", "part", "parts", "holdings", "moves", "alerts")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    ESTIMATOR_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    LOAD_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    PARTS_FIELD_NUMBER: _ClassVar[int]
    HOLDINGS_FIELD_NUMBER: _ClassVar[int]
    MOVES_FIELD_NUMBER: _ClassVar[int]
    ALERTS_FIELD_NUMBER: _ClassVar[int]
    version: int
    estimator: str
    time_ns: int
    epoch: int
    load: float
    part: int
    parts: int
    holdings: _containers.RepeatedCompositeFieldContainer[Holding]
    moves: _containers.RepeatedCompositeFieldContainer[Move]
    alerts: _containers.RepeatedCompositeFieldContainer[Alert]
    def __init__(self, version: _Optional[int] = ..., estimator: _Optional[str] = ..., time_ns: _Optional[int] = ..., epoch: _Optional[int] = ..., load: _Optional[float] = ..., part: _Optional[int] = ..., parts: _Optional[int] = ..., holdings: _Optional[_Iterable[_Union[Holding, _Mapping]]] = ..., moves: _Optional[_Iterable[_Union[Move, _Mapping]]] = ..., alerts: _Optional[_Iterable[_Union[Alert, _Mapping]]] = ...) -> None: ...

class Holding(_message.Message):
    __slots__ = ("device", "epoch", "boot", "next", "busy")
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    BOOT_FIELD_NUMBER: _ClassVar[int]
    NEXT_FIELD_NUMBER: _ClassVar[int]
    BUSY_FIELD_NUMBER: _ClassVar[int]
    device: str
    epoch: int
    boot: int
    next: int
    busy: bool
    def __init__(self, device: _Optional[str] = ..., epoch: _Optional[int] = ..., boot: _Optional[int] = ..., next: _Optional[int] = ..., busy: _Optional[bool] = ...) -> None: ...

class Move(_message.Message):
    __slots__ = ("time_ns", "came", "left", "reason")
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    CAME_FIELD_NUMBER: _ClassVar[int]
    LEFT_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    time_ns: int
    came: int
    left: int
    reason: _containers.RepeatedCompositeFieldContainer[Sentence]
    def __init__(self, time_ns: _Optional[int] = ..., came: _Optional[int] = ..., left: _Optional[int] = ..., reason: _Optional[_Iterable[_Union[Sentence, _Mapping]]] = ...) -> None: ...

class Checkpoint(_message.Message):
    __slots__ = ("version", "device", "boot", "epoch", "time_ns", "bridge", "calibration", "answers", "boot_repeated", "state", "placement", "alerts")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    BOOT_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    BRIDGE_FIELD_NUMBER: _ClassVar[int]
    CALIBRATION_FIELD_NUMBER: _ClassVar[int]
    ANSWERS_FIELD_NUMBER: _ClassVar[int]
    BOOT_REPEATED_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    PLACEMENT_FIELD_NUMBER: _ClassVar[int]
    ALERTS_FIELD_NUMBER: _ClassVar[int]
    version: int
    device: str
    boot: int
    epoch: int
    time_ns: int
    bridge: str
    calibration: Calibration
    answers: _containers.RepeatedCompositeFieldContainer[Answer]
    boot_repeated: bool
    state: bytes
    placement: Placement
    alerts: _containers.RepeatedCompositeFieldContainer[Alert]
    def __init__(self, version: _Optional[int] = ..., device: _Optional[str] = ..., boot: _Optional[int] = ..., epoch: _Optional[int] = ..., time_ns: _Optional[int] = ..., bridge: _Optional[str] = ..., calibration: _Optional[_Union[Calibration, _Mapping]] = ..., answers: _Optional[_Iterable[_Union[Answer, _Mapping]]] = ..., boot_repeated: _Optional[bool] = ..., state: _Optional[bytes] = ..., placement: _Optional[_Union[Placement, _Mapping]] = ..., alerts: _Optional[_Iterable[_Union[Alert, _Mapping]]] = ...) -> None: ...

class Answer(_message.Message):
    __slots__ = ("verb", "request_id", "accepted", "message")
    VERB_FIELD_NUMBER: _ClassVar[int]
    REQUEST_ID_FIELD_NUMBER: _ClassVar[int]
    ACCEPTED_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    verb: str
    request_id: str
    accepted: bool
    message: _containers.RepeatedCompositeFieldContainer[Sentence]
    def __init__(self, verb: _Optional[str] = ..., request_id: _Optional[str] = ..., accepted: _Optional[bool] = ..., message: _Optional[_Iterable[_Union[Sentence, _Mapping]]] = ...) -> None: ...

class Note(_message.Message):
    __slots__ = ("version", "device", "boot", "time_ns", "who", "text")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    BOOT_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    WHO_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    version: int
    device: str
    boot: int
    time_ns: int
    who: str
    text: str
    def __init__(self, version: _Optional[int] = ..., device: _Optional[str] = ..., boot: _Optional[int] = ..., time_ns: _Optional[int] = ..., who: _Optional[str] = ..., text: _Optional[str] = ...) -> None: ...

class Command(_message.Message):
    __slots__ = ("version", "request_id", "who", "reason", "placement")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    REQUEST_ID_FIELD_NUMBER: _ClassVar[int]
    WHO_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    PLACEMENT_FIELD_NUMBER: _ClassVar[int]
    version: int
    request_id: str
    who: str
    reason: str
    placement: Placement
    def __init__(self, version: _Optional[int] = ..., request_id: _Optional[str] = ..., who: _Optional[str] = ..., reason: _Optional[str] = ..., placement: _Optional[_Union[Placement, _Mapping]] = ...) -> None: ...

class CommandReply(_message.Message):
    __slots__ = ("version", "request_id", "accepted", "message")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    REQUEST_ID_FIELD_NUMBER: _ClassVar[int]
    ACCEPTED_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    version: int
    request_id: str
    accepted: bool
    message: _containers.RepeatedCompositeFieldContainer[Sentence]
    def __init__(self, version: _Optional[int] = ..., request_id: _Optional[str] = ..., accepted: _Optional[bool] = ..., message: _Optional[_Iterable[_Union[Sentence, _Mapping]]] = ...) -> None: ...
