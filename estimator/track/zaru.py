"""Zero angular rate update: while the device rests, its reading is its bias.

Rests are cut into pieces of about a second. A piece that contradicts the estimate is refused: it may be a bed or a chair
that turns slowly and evenly. When the device then stays as still as that for long, the contradiction itself is believed.
"""

from dataclasses import dataclass
from math import radians

import numpy as np
from numpy.typing import NDArray

from estimator.stillness import Window
from estimator.track.bias_filter import BiasFilter, Receipt

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ZaruKnobs:
    """When a rest speaks for the bias."""

    piece_s: float = 1.0
    #: motion of a resting body that no window shows, rad/s
    quasi_static: float = radians(0.003)
    #: least standard deviation of a reading: a coarse gyro at rest may show none at all
    resolution: float = radians(0.02)
    #: a contradiction that stays the same for this long is believed
    insist_s: float = 120.0


class Zaru:
    """Windows in, receipts out; feeds one BiasFilter."""

    def __init__(self, knobs: ZaruKnobs | None = None) -> None:
        self.knobs = knobs or ZaruKnobs()
        self._piece: list[Window] = []
        self._contradicted_since: float | None = None

    def window(self, window: Window, bias: BiasFilter, temperature_c: float) -> Receipt | None:
        """Take the next window; a receipt comes when it completes a piece of rest."""
        if not window.still:
            self._piece.clear()
            self._contradicted_since = None
            return None
        self._piece.append(window)
        if window.end_time - self._piece[0].start_time < self.knobs.piece_s:
            return None
        piece, self._piece = self._piece, []
        z, R = self._measure(piece)
        bias.predict(window.end_time, temperature_c)
        receipt = bias.update("zaru", z, R)
        return receipt if receipt.accepted else self._contradiction(receipt, piece[0].start_time, bias, z, R)

    def _measure(self, piece: list[Window]) -> tuple[Floats, Floats]:
        n = np.array([w.samples for w in piece], float)
        z = n @ np.array([w.mean for w in piece]) / n.sum()
        var = n @ np.square([w.std for w in piece]) / n.sum()
        R = np.diag(np.maximum(var, self.knobs.resolution**2) / n.sum() + self.knobs.quasi_static**2)
        return z, R

    def _contradiction(self, receipt: Receipt, start: float, bias: BiasFilter, z: Floats, R: Floats) -> Receipt:
        if self._contradicted_since is None:
            self._contradicted_since = start
        if receipt.time - self._contradicted_since < self.knobs.insist_s:
            return receipt
        self._contradicted_since = None
        bias.restart(z, R)
        r = receipt
        return Receipt(r.time, r.kind, r.innovation, r.innovation_cov, r.test_ratio, accepted=True, reason="insisted")
