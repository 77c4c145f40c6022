"""Corrected recording as arrays, one row per sample, and the class that fills the rows from corrected batches."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.wire.messages import AccelerometerCalibration, CorrectedBatch, Quality
from estimator.orientation.attitude import Oriented

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class CorrectedRecording:
    """Corrected rates of a recording: n rows, one per sample.

    Each row is corrected with calibration and bias as known at its sample's time. If `smoothed`, bias and attitude are
    estimated from the whole recording, and the last calibration is used in every row.

    time_s (n,): seconds since the first sample. rate (n, 3): corrected rate, rad/s, in the sensor frame.
    rate_std (n, 3): its standard deviation, rad/s, from noise, bias, bias instability, scale and misalignment.
    bias, bias_std (n, 3): reading at zero rate and its standard deviation, rad/s.
    quat_wxyz (n, 4): attitude as unit quaternion, sensor to earth (z up), scalar first; see docs/orientation.md.
    tilt_std, heading_std (n,): standard deviations of the attitude, rad.
    quality (n,): values of bridge.wire.messages.Quality. matrix (3, 3), calibration: matrix and calibration id of the
    last row.
    accelerometer: its calibration at the end, accepted or not, used by the attitudes. None before a rest or without
    accelerometer.
    rate_hz: output data rate. events: number of each kind of event. said: messages that the live service would have
    logged.

    Computed in float64, stored in float32 as on the wire.
    """

    time_s: Floats
    rate: Singles
    rate_std: Singles
    bias: Singles
    bias_std: Singles
    quality: NDArray[np.uint8]
    quat_wxyz: Singles
    tilt_std: Singles
    heading_std: Singles
    matrix: Floats
    accelerometer: AccelerometerCalibration | None
    calibration: str
    rate_hz: float
    smoothed: bool
    events: dict[str, int]
    said: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def rotation(self) -> Rotation:
        """Rotation from sensor to earth axes (z up) at each of the n samples.

        `rotation.apply(vectors)` takes vectors (n, 3) in sensor axes and returns them in earth axes.
        """
        return Rotation.from_quat(self.quat_wxyz, scalar_first=True)

    def seconds(self) -> dict[str, float]:
        """Return the seconds spent in each quality, by name, in the order of Quality; absent qualities are left out."""
        counts = np.bincount(self.quality, minlength=len(Quality))
        return {quality.name: float(counts[quality] / self.rate_hz) for quality in Quality if counts[quality]}


class Rows:
    """Columns of the n rows of a corrected recording, filled in order; `filled`: number of rows filled so far.

    rate, rate_std, bias, bias_std (n, 3): rad/s. quality (n,). quat_wxyz (n, 4): sensor to earth, scalar first.
    tilt_std, heading_std (n,): rad.
    """

    def __init__(self, n: int) -> None:
        self.filled = 0
        self.rate, self.rate_std, self.bias, self.bias_std = (np.empty((n, 3), np.float32) for _ in range(4))
        self.quality = np.empty(n, np.uint8)
        self.quat_wxyz = np.empty((n, 4), np.float32)
        self.tilt_std, self.heading_std = np.empty(n, np.float32), np.empty(n, np.float32)
        self._oriented = 0

    def take(self, batch: CorrectedBatch, matrix: Floats) -> None:
        """Fill the first unfilled rows with the rates, biases and quality of a corrected batch.

        matrix (3, 3): calibration matrix that corrected the batch, without unit.
        """
        part = slice(self.filled, self.filled + len(batch))
        self.rate[part], self.rate_std[part] = batch.rate, batch.rate_std
        self.bias[part], self.quality[part] = batch.bias, batch.quality
        # A batch's bias_std is that of the corrected rate; here the std of the bias as a reading is needed.
        var = np.linalg.solve(matrix**2, np.square(batch.bias_std.astype(float)))
        self.bias_std[part] = np.sqrt(np.maximum(var, 0.0))
        self.filled = part.stop

    def turn(self, attitudes: Oriented, first: int | None = None) -> None:
        """Fill the attitudes of consecutive rows, from row number `first` (from 0) on.

        first: None continues after the last row whose attitude was filled.
        """
        begin = self._oriented if first is None else first
        part = slice(begin, begin + len(attitudes.quat_wxyz))
        self.quat_wxyz[part] = attitudes.quat_wxyz
        self.tilt_std[part], self.heading_std[part] = attitudes.tilt_std, attitudes.heading_std
        self._oriented = part.stop
