"""Message types of calibrations: of a gyro and of an accelerometer, by truerate or by the device itself.

Angles are in rad, rates in rad/s.
"""

from dataclasses import dataclass
from enum import IntEnum

from bridge.reasons.codes import Sentences
from bridge.wire.sample_messages import Floats


class Verdict(IntEnum):
    """Verdict of a calibration: ACCEPTED, REPEAT (the axes named in the reason must be turned again) or REFUSED."""

    UNKNOWN = 0
    ACCEPTED = 1
    REPEAT = 2
    REFUSED = 3


@dataclass(frozen=True, slots=True)
class AccelerometerCalibration:
    """Calibration of an accelerometer from rests in different poses: corrected = scale (reading - bias), axis by axis.

    poses: number of different poses. bias (3,): m/s². scale (3,): without unit, for a gravity of 9.80665 m/s².
    covariance (36,): rows of the (6, 6) matrix of bias, then scale; the variances are in (m/s²)² and without unit.
    cross_std: standard deviation of the cross-axis sensitivity, the share of another axis' acceleration in an axis'
    reading, without unit.
    Without an accepted verdict, bias, scale and covariance are empty, and cross_std is 0.
    """

    verdict: Verdict
    reason: Sentences
    poses: int
    bias: tuple[float, ...] = ()
    scale: tuple[float, ...] = ()
    covariance: tuple[float, ...] = ()
    cross_std: float = 0.0

    @property
    def std(self) -> tuple[float, ...]:
        """Standard deviations (6,): bias (3,) in m/s², then scale (3,) without unit.

        Empty without an accepted verdict.
        """
        return tuple(var**0.5 for var in self.covariance[::7])


@dataclass(frozen=True, slots=True)
class Turn:
    """Turn of a calibration: axis, angle and closure error, after correction.

    axis: 0 for x, 1 for y, 2 for z. angle: rad, signed. closure_error: angle by which the turn misses its start, rad.
    duration_s: duration.
    """

    axis: int
    angle: float
    closure_error: float
    duration_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """Calibration result of a gyro: corrected rate = matrix (reading - bias), in rad/s, sensor frame.

    matrix (3, 3): without unit. bias (3,): rad/s. noise_std (3,): standard deviation of one reading, rad/s.
    covariance (p, p): of the p `parameters`: biases in rad/s, matrix elements (`k_x`, `m_xy` …) without unit.
    gyro_range: full-scale range, rad/s. rate_hz: output data rate. temperature_c: sensor temperature.
    time_ns: when it was made, ns since the Unix epoch. who: name of the person who requested the calibration.
    """

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
    accelerometer: AccelerometerCalibration | None = None  # by the rests of the boot until then; as in Status


@dataclass(frozen=True, slots=True)
class DeviceCalibration:
    """Calibration that a device made itself: corrected = scale (reading - bias), axis by axis.

    scale (3,): without unit. bias (3,): rad/s. boot: number of the boot in which the device made the calibration.
    sequence: number of the last sample used for it, by the device's 32-bit count.
    """

    boot: int
    sequence: int
    scale: tuple[float, ...]
    bias: tuple[float, ...]
