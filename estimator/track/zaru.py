"""Zero angular rate update: while the device rests, its reading is its bias.

Rests are cut into pieces of about a second. A piece that contradicts the estimate is refused: it may be a bed or a chair
that turns slowly and evenly. When the device then stays as still as that for long, the contradiction itself is believed.
"""

from dataclasses import dataclass
from math import radians

import numpy as np
from numpy.typing import NDArray

from estimator.gyro import mean_var, rounding_var
from estimator.stillness import Window
from estimator.track.bias_filter import BiasFilter, Receipt

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ZaruKnobs:
    """When a rest speaks for the bias."""

    piece_s: float = 1.0
    #: motion of a resting body that no window shows, rad/s
    quasi_static: float = radians(0.003)
    #: a contradiction that stays the same for this long is believed
    insist_s: float = 120.0


class Zaru:
    """Windows in, receipts out; feeds one BiasFilter."""

    def __init__(self, knobs: ZaruKnobs | None = None) -> None:
        self.knobs = knobs or ZaruKnobs()
        self._piece: list[Window] = []
        self._contradiction: tuple[float, Floats, Floats] | None = None  # since when, and what was measured then

    def window(self, window: Window, bias: BiasFilter, temperature_c: float) -> Receipt | None:
        """Take the next window; a receipt comes when it completes a piece of rest."""
        if not window.still:
            self._piece.clear()
            self._contradiction = None
            return None
        self._piece.append(window)
        if window.end_time - self._piece[0].start_time < self.knobs.piece_s:
            return None
        piece, self._piece = self._piece, []
        z, R, common_var = self._measure(piece)
        bias.predict(window.end_time, temperature_c)
        receipt = bias.update("zaru", z, R, common_var)
        if receipt.accepted:
            self._contradiction = None
            return receipt
        return self._contradicted(receipt, piece[0].start_time, bias, z, R)

    def _measure(self, piece: list[Window]) -> tuple[Floats, Floats, Floats]:
        n = np.array([w.samples for w in piece], float)
        z = n @ np.array([w.mean for w in piece]) / n.sum()
        std = np.sqrt(n @ np.square([w.std for w in piece]) / n.sum())
        step = np.min([w.step for w in piece], axis=0)
        R = np.diag(mean_var(std, step, float(n.sum())) + self.knobs.quasi_static**2)
        return z, R, rounding_var(std, step)

    def _contradicted(self, receipt: Receipt, start: float, bias: BiasFilter, z: Floats, R: Floats) -> Receipt:
        if self._contradiction is None or not self._same(*self._contradiction, receipt.time, z, R, bias):
            self._contradiction = start, z, R
        if receipt.time - self._contradiction[0] < self.knobs.insist_s:
            return receipt
        self._contradiction = None
        bias.restart(z, R)
        r = receipt
        return Receipt(r.time, r.kind, r.innovation, r.innovation_cov, r.test_ratio, accepted=True, reason="insisted")

    def _same(
        self, since: float, first: Floats, first_R: Floats, time: float, z: Floats, R: Floats, bias: BiasFilter
    ) -> bool:
        walk = bias.knobs.rate_random_walk**2 * (time - since) * np.eye(3)
        apart = z - first
        return bool(apart @ np.linalg.solve(R + first_R + walk, apart) <= bias.knobs.gate)
