"""The correction in force and its uncertainty: chosen from all that is known of a device."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.wire.messages import Calibration, Quality
from estimator.geometry.gyro_model import AXES, GyroModel, PriorKnobs, uncalibrated
from estimator.state import shaped

Floats = NDArray[np.float64]
Float32s = NDArray[np.float32]


class PublishedCorrection(NamedTuple):
    """What every CorrectedBatch says of its parameters: (3,) each, of corrected rates but for the bias."""

    noise_std: Float32s
    bias_std: Float32s
    scale_std: Float32s
    cross_std: Float32s
    bias: Float32s
    flicker_std: Float32s


@dataclass(frozen=True, eq=False)
class Correction:
    """One set of parameters: everything a CorrectedBatch carries beside its samples. bias_std (3,) rad/s, flicker rad/s."""

    model: GyroModel
    bias_std: Floats
    quality: Quality
    calibration: str
    flicker: float

    @cached_property
    def told(self) -> PublishedCorrection:
        """As all batches that it corrects say it: the very same arrays."""
        model, of_reading, rows = self.model, np.empty((3, 3)), np.empty((6, 3), np.float32)
        of_reading[0], of_reading[1], of_reading[2] = model.noise_std, self.bias_std, self.flicker
        rows[0], rows[1], rows[5] = model.corrected_std(of_reading)
        rows[2], rows[3], rows[4] = model.scale_std, model.cross_std, model.bias
        return PublishedCorrection(*rows)

    @cached_property
    def parameters(self) -> Floats:
        """(12,) matrix and bias, one after the other."""
        return np.concatenate([self.model.matrix.ravel(), self.model.bias])

    def check(self) -> None:
        """Raises ValueError where no reading can be corrected by it."""
        model = self.model
        shaped(model.matrix, 3, 3, finite=True)
        shaped(model.bias, 3, finite=True)
        for std in (model.scale_std, model.cross_std, model.noise_std, self.bias_std):
            shaped(std, 3)

    def same(self, other: "Correction") -> bool:
        """Whether both correct alike, to the last bit."""
        mine, theirs = self.model, other.model
        return (
            self.quality is other.quality
            and self.calibration == other.calibration
            and self.flicker == other.flicker
            and _same(mine.bias, theirs.bias)
            and _same(self.bias_std, other.bias_std)
            and _same(mine.noise_std, theirs.noise_std)
            and _same(mine.matrix, theirs.matrix)
            and _same(mine.scale_std, theirs.scale_std)
            and _same(mine.cross_std, theirs.cross_std)
        )


def _same(a: Floats, b: Floats) -> bool:
    """Whether both are the same array, or alike: of so few numbers lists tell it in a tenth of NumPy's time."""
    return a is b or a.tolist() == b.tolist()


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """What is known of a gyro before its bias is tracked: the model, bias_std (3,) rad/s of its bias, and how good that is."""

    model: GyroModel
    bias_std: Floats
    quality: Quality
    calibration: str = ""


def believed(
    calibration: Calibration | None, earlier: Calibration | None, knobs: PriorKnobs, moves: float | None = None
) -> Belief:
    """The best there is: this boot's calibration, else an earlier boot's scale, else the datasheet.

    moves: how far its scale does from boot to boot (see gyro.repeatability); where that is not known, as far as those of its kind
    may be off at all. Its bias may.
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
) -> Correction:
    """What is believed of a gyro, with the tracked bias (3,), its bias_std (3,), and by how much it flickers, rad/s.

    noise_std (3,) is what the present rest shows, or None. sure: the bias is known well enough to be called known, and nothing
    speaks against it. away: nothing comes of the device.
    """
    quality = belief.quality
    if quality is Quality.GOOD:
        quality = Quality.DEGRADED if away or not sure else Quality.GOOD
    elif sure:
        quality = Quality.BIAS_ONLY
    known = belief.model
    noise_std = known.noise_std if noise_std is None else noise_std
    model = GyroModel(known.matrix, bias, known.scale_std, known.cross_std, noise_std)
    return Correction(model, bias_std, quality, belief.calibration, flicker)


def _cross_std(used: Calibration, knobs: PriorKnobs) -> Floats:
    """(3,) of each row of the matrix what is not known beside its diagonal: as calibrated, else as parts are made."""
    across = [number for number, name in enumerate(used.parameters) if name.startswith("m_")]
    if not across:
        return np.full(3, knobs.misalignment_std)
    var = np.zeros(3)
    for number in across:
        var[AXES.index(used.parameters[number][2])] += used.covariance[number, number] / 2
    return np.asarray(np.sqrt(var))
