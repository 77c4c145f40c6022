"""Correction parameters in use and their uncertainty, chosen from calibration, prior and tracked bias."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bridge.wire.batches import MAX_RATE, MAX_STD, TOLD
from bridge.wire.messages import Calibration, Quality
from estimator.geometry.gyro_model import AXES, GyroModel, PriorKnobs, uncalibrated
from estimator.orientation.attitude import known
from estimator.state import Floats, shaped

Float32s = NDArray[np.float32]
#: range of each row of `Correction.told` on the wire; a row that is not a number becomes the largest
_MOST = np.array([[MAX_RATE if name == "bias" else MAX_STD] for name in TOLD], np.float32)
_LEAST = np.array([[-MAX_RATE if name == "bias" else 0.0] for name in TOLD], np.float32)
#: m/s², bias of an accelerometer of which gravity has taught nothing yet
_ACCEL_STD = 0.05
#: bias, m/s², and scale of an accelerometer that is not calibrated
_AS_READ = np.repeat([0.0, 1.0], 3)


@dataclass(frozen=True, eq=False)
class Correction:
    """Parameters that correct a reading, with their uncertainty, in sensor axes.

    model: matrix (3, 3, no unit), bias (3, rad/s), and standard deviations of noise (rad/s), scale factors and
    misalignment (relative).
    quality: quality of the corrected rates. bias_std (3,): standard deviation of the bias, rad/s. calibration: id of
    the calibration in use.
    flicker: standard deviation of the bias instability, rad/s. walk: rate random walk, rad/s/√s.

    `taught` and `accel` are used by the orientation estimate only, and are None until known.
    taught (21,), estimated from gravity: relative change of the matrix (9, row by row), its standard deviation (9), and
    the standard deviation of the accelerometer bias (3, m/s²).
    accel (9,), of a calibrated accelerometer: bias (3, m/s²), scale factors (3), standard deviation of the bias (3,
    m/s²).
    """

    model: GyroModel
    bias_std: Floats
    quality: Quality
    calibration: str
    flicker: float
    walk: float = 0.0
    taught: Floats | None = None
    accel: Floats | None = None

    @cached_property
    def told(self) -> Float32s:
        """Parameters (6, 3) published with every CorrectedBatch, limited to the range of the wire format.

        TOLD names the rows. Rows 0 to 2: standard deviation of the corrected rate due to noise, bias and bias
        instability, rad/s. Rows 3 and 4: relative standard deviation of scale factor and misalignment. Row 5: bias of
        the reading, rad/s.
        """
        model, rows = self.model, np.empty((6, 3))
        rows[0], rows[1], rows[2] = model.noise_std, self.bias_std, self.flicker
        rows[:3] = model.corrected_std(rows[:3])
        rows[3], rows[4], rows[5] = model.scale_std, model.cross_std, model.bias
        return np.fmax(_LEAST, np.fmin(_MOST, rows.astype(np.float32)))

    @cached_property
    def parameters(self) -> Floats:
        """Calibration matrix (9, row by row, without unit) and bias (3, rad/s), concatenated to (12,)."""
        return np.concatenate([self.model.matrix.ravel(), self.model.bias])

    @cached_property
    def known(self) -> Floats:
        """Sensor parameters with uncertainties, packed into one array (38,) for the orientation estimate.

        Order: calibration matrix (9, row by row, no unit); bias (3, rad/s).
        Then standard deviations: bias (3, rad/s), matrix (9, relative), accelerometer bias (3, m/s²), white noise (3,
        rad/s), bias instability (1, rad/s).
        Then rate random walk (1, rad/s/√s).
        Then values of the accelerometer: bias (3, m/s²), scale factors (3, no unit).
        """
        model, accel = self.model, _AS_READ
        if self.taught is None:
            std = np.repeat([*model.cross_std, _ACCEL_STD], 3)
            std[:9:4] = model.scale_std
        else:
            change, std = self.taught[:9].reshape(3, 3), self.taught[9:]
            model = replace(model, matrix=model.matrix + change @ model.matrix)
        if self.accel is not None:
            accel, std = self.accel[:6], np.concatenate([std[:9], self.accel[6:]])
        return known(model, self.bias_std, std, self.flicker, self.walk, accel)

    def check(self) -> None:
        """Check shapes and values of the parameters. Raises ValueError if they cannot correct a reading."""
        model = self.model
        shaped(model.matrix, 3, 3, finite=True)
        shaped(model.bias, 3, finite=True)
        for std in (model.scale_std, model.cross_std, model.noise_std, self.bias_std):
            shaped(std, 3)
        if self.taught is not None:
            shaped(self.taught, 21, finite=True)
        if self.accel is not None:
            shaped(self.accel, 9, finite=True)


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """Prior knowledge of a gyro, before its bias is tracked: gyro model, bias uncertainty and origin.

    model: matrix (3, 3, no unit), bias (3, rad/s), and standard deviations of noise (rad/s), scale factors and
    misalignment (relative). bias_std (3,): standard deviation of the bias, rad/s.
    quality: best possible quality of rates corrected with this model. calibration: id of the calibration it comes from;
    empty for the datasheet.
    """

    model: GyroModel
    bias_std: Floats
    quality: Quality
    calibration: str = ""


def believed(
    calibration: Calibration | None, earlier: Calibration | None, knobs: PriorKnobs, moves: float | None = None
) -> Belief:
    """Choose the best available gyro model: this boot's calibration, else an earlier boot's, else the datasheet.

    calibration: of this boot, or None. earlier: of an earlier boot, or None; its bias is only a starting value. knobs:
    settings of the prior.
    moves: relative standard deviation of the change of the scale factors from boot to boot (see
    gyro_model.repeatability); None if unknown, then `knobs.scale_std` replaces it.
    The standard deviation of the bias is `knobs.bias_std`, rad/s, in every case.
    """
    used = calibration or earlier
    if used is None:
        return Belief(uncalibrated(knobs), np.full(3, knobs.bias_std), Quality.NONE)
    scale = np.diag(used.matrix)
    scale_var = np.diag(used.covariance)[3:6] / scale**2
    if calibration is None:
        scale_var = scale_var + (knobs.scale_std if moves is None else moves) ** 2
    model = GyroModel(used.matrix, used.bias, np.sqrt(scale_var), _cross_std(used, knobs), used.noise_std)
    bias_std = np.full(3, knobs.bias_std)
    return Belief(model, bias_std, Quality.PRIOR if calibration is None else Quality.GOOD, used.id)


def choose(
    belief: Belief,
    bias: Floats,
    bias_std: Floats,
    noise_std: Floats | None,
    flicker: float,
    *,
    sure: bool,
    away: bool = False,
    walk: float = 0.0,
    taught: Floats | None = None,
    accel: Floats | None = None,
) -> Correction:
    """Combine the gyro model in use with the tracked bias into a correction, and grade its quality.

    bias, bias_std (3,): tracked bias and its standard deviation, rad/s. noise_std (3,): white noise of a reading in the
    present rest, rad/s; None for the model's. flicker: standard deviation of the bias instability, rad/s.
    sure: whether the bias is known well enough and not in doubt. away: whether the device sends nothing.
    walk: rate random walk, rad/s/√s. taught (21,), accel (9,): parameters of the orientation, as in `Correction`.

    Quality GOOD needs a calibration of this boot, a sure bias, and a device that sends.
    """
    quality = belief.quality
    if quality is Quality.GOOD:
        quality = Quality.DEGRADED if away or not sure else Quality.GOOD
    elif sure:
        quality = Quality.BIAS_ONLY
    known = belief.model
    noise_std = known.noise_std if noise_std is None else noise_std
    model = GyroModel(known.matrix, bias, known.scale_std, known.cross_std, noise_std)
    return Correction(model, bias_std, quality, belief.calibration, flicker, walk, taught, accel)


def _cross_std(used: Calibration, knobs: PriorKnobs) -> Floats:
    """(3,) std of each matrix row beside its diagonal, relative: as calibrated, else `knobs.misalignment_std`."""
    across = [number for number, name in enumerate(used.parameters) if name.startswith("m_")]
    if not across:
        return np.full(3, knobs.misalignment_std)
    var = np.zeros(3)
    for number in across:
        var[AXES.index(used.parameters[number][2])] += used.covariance[number, number] / 2
    return np.asarray(np.sqrt(var))
