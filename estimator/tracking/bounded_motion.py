"""Bounded-motion evidence of the bias: a wearer who breathes, sways or dozes turns to and fro within a small angle.

The evidence is taken from stretches of 30 s. The mean true rate of a stretch is the rotation from its first attitude to
its last, divided by its duration. The angle by which the body swings within the stretch gives the standard deviation of
this rotation.
The measurement is the mean bias of the stretch. It is corrected for temperature changes, and its variance includes the
random walk up to the present.
"""

from dataclasses import dataclass, replace
from math import radians

import msgspec
import numpy as np

from estimator.kernels.zaru import upright
from estimator.state import Floats, StateStruct, shaped
from estimator.tracking.bias_filter import BiasFilter
from estimator.tracking.bias_state import BIAS, SLOPE
from estimator.tracking.evidence import GATES, Evidence, Receipt
from estimator.tracking.seconds import Second
from estimator.tracking.zaru import INSISTED

VERTICAL = "bounded vertical"
#: start, end, mean, its variance, the part of the variance common to all, temperature
_Kept = tuple[float, float, Floats, Floats, Floats, float]


#: s, length of a stretch
_STRETCH_S = 30.0
#: rad; a body that swings farther is moving
_SWING = radians(10.0)
#: rad, least standard deviation between the ends: smaller motion does not show in the readings
_LEAST_WAY = radians(0.2)
#: crossings of the mean per stretch; with fewer the body may be leaving as well as coming back
_RETURNS = 7.0
#: number of agreeing stretches in a row that overrule the bias: a bed's turns change from stretch to stretch
INSIST = 4
#: about the vertical, where no accelerometer helps and a bed may turn for minutes: NIS gate, and number of stretches
_VERTICAL_GATE, VERTICAL_INSIST = 16.0, 10


@dataclass(frozen=True, slots=True, eq=False)
class _Refused:
    """Refused stretches in a row that agree: number, bias `said` (3,) with covariance cov, time, s, and temperature, °C."""

    count: int
    said: Floats
    cov: Floats
    time: float
    celsius: float


class BoundedMotion(StateStruct):
    """Bounded-motion evidence of the bias: takes quiet one-second blocks, and updates the filter after each 30 s stretch.

    seconds: data of the blocks of the present, unfinished stretch.
    refused: by kind of evidence, a series of refused measurements that agree with each other.
    Raises ValueError for arrays of wrong shape.
    """

    seconds: list[_Kept] = msgspec.field(default_factory=list)
    refused: dict[str, _Refused] = msgspec.field(default_factory=dict)

    def __post_init__(self) -> None:
        for _, _, *means, _ in self.seconds:
            for mean in means:
                shaped(mean, 3)
        for refused in self.refused.values():
            shaped(refused.said, 3)
            shaped(refused.cov, 3, 3)

    def take(self, second: Second, bias: BiasFilter, up: Floats | None = None) -> list[Receipt]:
        """Add a one-second block; at the end of a 30 s stretch, update the filter and return the receipts.

        second: a block in which the device is quiet but not at rest; blocks must come in the order of time.
        bias: the filter, already predicted to the end of the block.
        up (3,): gravity in sensor axes, of any length; None without an accelerometer.
        Returns an empty list before the end of a stretch, and for a stretch in which the body swings more than 10°.
        """
        self.seconds.append(
            (second.start, second.end, second.mean, second.mean_var, second.common_var, bias.temperature_c)
        )
        seconds = self.seconds[-1][1] - self.seconds[0][0]
        if seconds < _STRETCH_S:
            return []
        starts, ends, means, variances, commons, celsius = (
            np.array(column) for column in zip(*self.seconds, strict=True)
        )
        self.seconds.clear()
        lasted = (ends - starts)[:, None]
        z = (means * lasted).sum(axis=0) / seconds
        colder = np.nan_to_num(celsius - bias.temperature_c)[:, None]
        swung = means - colder * bias.x[SLOPE]
        way = np.cumsum((swung - (swung * lasted).sum(axis=0) / seconds) * lasted, axis=0)
        if np.any(np.abs(way) > _SWING):
            return []
        common = commons.max(axis=0)
        noise = ((variances - commons) * lasted**2).sum(axis=0) / seconds**2 + common
        bend = bias.knobs.curvature / 2 * float((colder**2 * lasted).sum()) / seconds
        # The mean of a random walk differs from its end by a third of the variance from begin to end.
        walk = bias.walked(seconds) / 3 + bend**2
        H = np.zeros((3, len(bias.x)))
        H[:, BIAS], H[:, SLOPE] = np.eye(3), float((colder * lasted).sum()) / seconds * np.eye(3)
        receipts = []
        for kind, axes in _parts(up):
            R = np.diag(self._ends_var(way @ axes.T) / seconds**2) + (axes * (noise + walk)) @ axes.T
            gate = _VERTICAL_GATE if kind == VERTICAL else GATES[len(axes)]
            receipts.append(self._judged(Evidence(kind, axes @ z, axes @ H, R, gate, axes**2 @ common), bias))
        return receipts

    def _ends_var(self, way: Floats) -> Floats:
        """(m,) variance of the distance between start and end of a way (n, m): twice its swing, more if it swings rarely."""
        swing = way - way.mean(axis=0)
        crossed = np.count_nonzero(np.diff(swing > 0, axis=0), axis=0)
        doubt = 1 + (_RETURNS / np.maximum(crossed, 1)) ** 2
        return np.asarray(np.maximum(2 * doubt * np.mean(swing**2, axis=0), _LEAST_WAY**2))

    def _judged(self, evidence: Evidence, bias: BiasFilter) -> Receipt:
        """Update with the evidence, or refuse it until enough stretches agree."""
        kind, receipt = evidence.kind, bias.update(evidence)
        before = self.refused.pop(kind, None)
        if receipt.accepted:
            return receipt
        refused = _against(before, evidence, receipt.innovation, bias)
        if refused.count < (VERTICAL_INSIST if kind == VERTICAL else INSIST):
            self.refused[kind] = refused
            return receipt
        bias.widen(float(np.mean(receipt.innovation**2)) * np.eye(3))
        bias.update(evidence)
        return receipt._replace(accepted=True, reason=INSISTED)


def _against(before: _Refused | None, evidence: Evidence, innovation: Floats, bias: BiasFilter) -> _Refused:
    """Count a refused stretch: one more if it agrees with the earlier ones, else the first of a new series."""
    axes = evidence.H[:, BIAS]
    said, cov = bias.x[BIAS] + axes.T @ innovation, axes.T @ evidence.R @ axes
    if before is not None:
        warmer = float(np.nan_to_num(bias.temperature_c - before.celsius))
        apart = axes @ (said - before.said - warmer * bias.x[SLOPE])
        moved = bias.walked(bias.time - before.time) * np.eye(3) + warmer**2 * bias.cov[SLOPE, SLOPE]
        if apart @ np.linalg.solve(axes @ (cov + before.cov + moved) @ axes.T, apart) <= GATES[len(apart)]:
            return replace(before, count=before.count + 1)
    return _Refused(1, said, cov, bias.time, bias.temperature_c)


def _parts(up: Floats | None) -> list[tuple[str, Floats]]:
    """Kinds of evidence, and the axes (m, 3) of each."""
    if up is None:
        return [("bounded", np.eye(3))]
    along = upright(up)
    return [("bounded level", along[:2]), (VERTICAL, along[2:])]
