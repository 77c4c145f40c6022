"""A corrected recording: a row for each of its samples, as arrays; and how rows are filled from corrected batches."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.wire.messages import CorrectedBatch, Quality

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class CorrectedRecording:
    """n rows, one for each sample: what was known when it came or, smoothed, what is known of it in the end.

    time_s (n,) since the first sample; rate (n, 3) rad/s, corrected; rate_std (n, 3): noise, bias and its flicker, scale,
    misalignment; bias (n, 3) rad/s, the reading at zero rate; bias_std (n, 3); quality (n,) of bridge.wire.messages.Quality.
    Computed in float64 and kept in float32, as on the wire. matrix (3, 3) and calibration, its id, are the last row's.
    events: counts of what happened on the way; said: what a service would have logged.
    """

    time_s: Floats
    rate: Singles
    rate_std: Singles
    bias: Singles
    bias_std: Singles
    quality: NDArray[np.uint8]
    matrix: Floats
    calibration: str
    rate_hz: float
    smoothed: bool
    events: dict[str, int]
    said: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.time_s)

    def seconds(self) -> dict[str, float]:
        """How long each quality lasted, by its name, in the order of quality; those that never were are left out."""
        counts = np.bincount(self.quality, minlength=len(Quality))
        return {quality.name: float(counts[quality] / self.rate_hz) for quality in Quality if counts[quality]}


class Rows:
    """The columns of n rows, filled in order."""

    def __init__(self, n: int) -> None:
        self.filled = 0
        self.rate, self.rate_std, self.bias, self.bias_std = (np.empty((n, 3), np.float32) for _ in range(4))
        self.quality = np.empty(n, np.uint8)

    def take(self, batch: CorrectedBatch, matrix: Floats) -> None:
        """Fill the next rows from a batch that was corrected by this matrix (3, 3)."""
        part = slice(self.filled, self.filled + len(batch))
        self.rate[part], self.rate_std[part] = batch.rate, batch.rate_std
        self.bias[part], self.quality[part] = batch.bias, batch.quality
        # A batch says what the bias leaves in corrected rates; here its own deviation is wanted, in readings.
        var = np.linalg.solve(matrix**2, np.square(batch.bias_std.astype(float)))
        self.bias_std[part] = np.sqrt(np.maximum(var, 0.0))
        self.filled = part.stop
