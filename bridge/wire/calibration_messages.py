"""Message types of calibrations, of a gyro and of an accelerometer, made here or by the device.

Angles are in rad, rates in rad/s.
"""

from dataclasses import dataclass
from enum import IntEnum

from bridge.reasons.codes import Sentences
from bridge.wire.sample_messages import Floats


class Verdict(IntEnum):
    """Verdict of a calibration: ACCEPTED, REPEAT (turn again about the axes named in the reason) or REFUSED."""

    UNKNOWN = 0
    ACCEPTED = 1
    REPEAT = 2
    REFUSED = 3


@dataclass(frozen=True, slots=True)
class AccelerometerCalibration:
    """Calibration of an accelerometer by rests in different poses: corrected = scale (reading - bias), axis by axis.

    poses: number of different poses. bias (3) m/s²; scale (3), relative to a gravity of 9.80665 m/s².
    covariance (36), row by row, of bias and scale. cross_std: standard deviation of the part of each other axis in an
    axis' reading, relative. Without an accepted verdict bias, scale and covariance are empty, and cross_std is 0.
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
        """Standard deviations (6): bias (3) in m/s², then scale (3); empty without an accepted verdict."""
        return tuple(var**0.5 for var in self.covariance[::7])


@dataclass(frozen=True, slots=True)
class Turn:
    """One turn of a calibration: signed angle and closure error in rad, both after correction.

    axis: 0 x, 1 y, 2 z. duration_s: s.
    """

    axis: int
    angle: float
    closure_error: float
    duration_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """Calibration result of a gyro: corrected = matrix (reading - bias), in rad/s.

    matrix (3, 3); bias (3,) rad/s; covariance (p, p) of the p `parameters`; noise_std (3,) rad/s of one reading.
    gyro_range: full scale in rad/s. time_ns: since the Unix epoch. who: the person who asked for it.
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

    scale (3,), without unit; bias (3,) rad/s. boot: number of the boot in which the device made it.
    sequence: number of the last sample it was made of, as the device counts: 32 bits.
    """

    boot: int
    sequence: int
    scale: tuple[float, ...]
    bias: tuple[float, ...]
