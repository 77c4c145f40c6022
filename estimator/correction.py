"""What is applied to readings, and how sure it is: chosen from all that is known of a device, applied to a run of samples."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bridge.wire.messages import Calibration, CorrectedBatch, Quality, SampleBatch
from estimator.gyro import AXES, GyroModel, PriorKnobs, uncalibrated
from estimator.track.bias_filter import BiasState

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Correction:
    """One set of parameters: everything a CorrectedBatch carries beside its samples. bias_std (3,) rad/s."""

    model: GyroModel
    bias_std: Floats
    quality: Quality
    calibration: str

    def same(self, other: "Correction") -> bool:
        """Whether both correct alike, to the last bit."""
        mine, theirs = self.model, other.model
        return (self.quality, self.calibration) == (other.quality, other.calibration) and all(
            np.array_equal(a, b)
            for a, b in (
                (mine.bias, theirs.bias),
                (mine.matrix, theirs.matrix),
                (mine.scale_std, theirs.scale_std),
                (mine.cross_std, theirs.cross_std),
                (mine.noise_std, theirs.noise_std),
                (self.bias_std, other.bias_std),
            )
        )

    def apply(self, batch: SampleBatch, start: int, end: int) -> CorrectedBatch:
        """Samples start to end of the batch, corrected."""
        model, part = self.model, slice(start, end)
        since = float(batch.ticks[start] - batch.ticks[0]) * batch.tick_period_s * batch.clock_rate
        return CorrectedBatch(
            device=batch.device,
            boot=batch.boot,
            sequence=batch.sequence + start,
            start_time_ns=batch.start_time_ns + round(since * 1e9),
            tick_period_s=batch.tick_period_s,
            clock_rate=batch.clock_rate,
            ticks=batch.ticks[part],
            rate=model.correct(batch.gyro[part].astype(float)).astype(np.float32),
            flags=batch.flags[part],
            quality=self.quality,
            noise_std=model.corrected_std(model.noise_std).astype(np.float32),
            bias_std=model.corrected_std(self.bias_std).astype(np.float32),
            scale_std=model.scale_std.astype(np.float32),
            cross_std=model.cross_std.astype(np.float32),
            bias=model.bias.astype(np.float32),
            calibration=self.calibration,
        )


def choose(
    calibration: Calibration | None,
    earlier: Calibration | None,
    bias: BiasState | None,
    noise_std: Floats | None,
    knobs: PriorKnobs,
) -> Correction:
    """The best there is: this boot's calibration, else an earlier boot's scale, else the datasheet; with the tracked bias.

    noise_std (3,) is what the present rest shows, or None.
    """
    used = calibration or earlier
    model, bias_std, quality = uncalibrated(knobs), np.full(3, knobs.bias_std), Quality.NONE
    if used is not None:
        scale = np.diag(used.matrix)
        scale_var = np.diag(used.covariance)[3:6] / scale**2
        if calibration is None:
            scale_var = scale_var + knobs.scale_repeatability**2
        cross_std = _cross_std(used, knobs)
        model = GyroModel(used.matrix, used.bias, np.sqrt(scale_var), cross_std, used.noise_std)
        bias_std = np.full(3, knobs.bias_repeatability)
        quality = Quality.PRIOR
    if bias is not None:
        model, bias_std = replace(model, bias=bias.x), bias.std
        quality = Quality.BIAS_ONLY
    if calibration is not None:
        quality = Quality.GOOD
    if noise_std is not None:
        model = replace(model, noise_std=noise_std)
    return Correction(model, bias_std, quality, used.id if used is not None else "")


def _cross_std(used: Calibration, knobs: PriorKnobs) -> Floats:
    """(3,) of each row of the matrix what is not known beside its diagonal: as calibrated, else as parts are made."""
    across = [number for number, name in enumerate(used.parameters) if name.startswith("m_")]
    if not across:
        return np.full(3, knobs.misalignment_std)
    var = np.zeros(3)
    for number in across:
        var[AXES.index(used.parameters[number][2])] += used.covariance[number, number] / 2
    return np.asarray(np.sqrt(var))
