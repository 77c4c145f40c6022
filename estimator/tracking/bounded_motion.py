"""Bounded-motion evidence: a wearer who breathes, sways or dozes turns to and fro, but not away.

Over a long stretch the mean of the true rate is the way from its first attitude to its last, over its time. How far the way
swings is seen in the stretch itself. The bias of that mean is an older one than that of now: warmth and the walk lie between.
"""

from dataclasses import dataclass, replace
from math import radians

import msgspec
import numpy as np
from numpy.typing import NDArray

from estimator.kernels.zaru import upright
from estimator.state import StateStruct, shaped
from estimator.tracking.bias_filter import BIAS, SLOPE, BiasFilter
from estimator.tracking.evidence import GATES, Evidence, Receipt
from estimator.tracking.seconds import Second
from estimator.tracking.zaru import INSISTED

Floats = NDArray[np.float64]
VERTICAL = "bounded vertical"
#: start, end, mean, its variance, the part of that which all share, temperature
_Kept = tuple[float, float, Floats, Floats, Floats, float]


@dataclass(frozen=True, slots=True)
class BoundedMotionKnobs:
    """What a bounded stretch is."""

    stretch_s: float = 30.0
    #: a body that swings farther is moving
    swing: float = radians(10.0)
    #: and one that seems to end nearer to where it began does not: no reading shows it
    least_way: float = radians(0.2)
    #: who crosses the mean of the way no more often than this in a stretch may as well be leaving as coming back
    returns: float = 7.0
    #: so many stretches in a row that contradict the bias are believed, if they say the same: a bed turns now so, now so
    insist: int = 4
    #: about the vertical, which no accelerometer checks: a bed may turn for minutes. Normalised innovation squared, and stretches
    vertical_gate: float = 16.0
    vertical_insist: int = 10


@dataclass(frozen=True, slots=True, eq=False)
class _Refused:
    """So many stretches in a row said that the bias was another: `said` with covariance cov, at a time and a temperature."""

    count: int
    said: Floats
    cov: Floats
    time: float
    celsius: float


class BoundedMotionState(StateStruct):
    """The seconds of the stretch so far, and what stretches before it said against the bias, by kind of evidence."""

    seconds: list[_Kept] = msgspec.field(default_factory=list)
    refused: dict[str, _Refused] = msgspec.field(default_factory=dict)


class BoundedMotion:
    """Quiet seconds in, a receipt for each whole stretch out."""

    def __init__(self, knobs: BoundedMotionKnobs | None = None) -> None:
        self.knobs = knobs or BoundedMotionKnobs()
        self.state = BoundedMotionState()

    def restore(self, state: BoundedMotionState) -> None:
        """Go on from a state. Raises ValueError."""
        for _, _, *means, _ in state.seconds:
            for mean in means:
                shaped(mean, 3)
        for refused in state.refused.values():
            shaped(refused.said, 3)
            shaped(refused.cov, 3, 3)
        self.state = state

    def broken(self) -> None:
        """The stretch is over."""
        self.state.seconds.clear()

    def take(self, second: Second, bias: BiasFilter, up: Floats | None = None) -> list[Receipt]:
        """Take the next second, to the end of which the filter has gone on; receipts when it completes a stretch.

        up (3,) points as gravity's reading does, None without an accelerometer.
        """
        self.state.seconds.append(
            (second.start, second.end, second.mean, second.mean_var, second.common_var, bias.temperature_c)
        )
        seconds = self.state.seconds[-1][1] - self.state.seconds[0][0]
        if seconds < self.knobs.stretch_s:
            return []
        starts, ends, means, variances, commons, celsius = (
            np.array(column) for column in zip(*self.state.seconds, strict=True)
        )
        self.state.seconds.clear()
        lasted = (ends - starts)[:, None]
        z = (means * lasted).sum(axis=0) / seconds
        colder = np.nan_to_num(celsius - bias.temperature_c)[:, None]
        swung = means - colder * bias.x[SLOPE]
        way = np.cumsum((swung - (swung * lasted).sum(axis=0) / seconds) * lasted, axis=0)
        if np.any(np.abs(way) > self.knobs.swing):
            return []
        common = commons.max(axis=0)
        noise = ((variances - commons) * lasted**2).sum(axis=0) / seconds**2 + common
        bend = bias.knobs.curvature / 2 * float((colder**2 * lasted).sum()) / seconds
        # The mean over a walk strays from its end by a third of what the end strays from its begin.
        walk = bias.walked(seconds) / 3 + bend**2
        H = np.zeros((3, len(bias.x)))
        H[:, BIAS], H[:, SLOPE] = np.eye(3), float((colder * lasted).sum()) / seconds * np.eye(3)
        receipts = []
        for kind, axes in _parts(up):
            R = np.diag(self._ends_var(way @ axes.T) / seconds**2) + (axes * (noise + walk)) @ axes.T
            gate = self.knobs.vertical_gate if kind == VERTICAL else GATES[len(axes)]
            receipts.append(self._judged(Evidence(kind, axes @ z, axes @ H, R, gate, axes**2 @ common), bias))
        return receipts

    def _ends_var(self, way: Floats) -> Floats:
        """(m,) variance of how far a way (n, m) ends from where it began: two moments of its swing, if it swings often."""
        swing = way - way.mean(axis=0)
        crossed = np.count_nonzero(np.diff(swing > 0, axis=0), axis=0)
        doubt = 1 + (self.knobs.returns / np.maximum(crossed, 1)) ** 2
        return np.asarray(np.maximum(2 * doubt * np.mean(swing**2, axis=0), self.knobs.least_way**2))

    def _judged(self, evidence: Evidence, bias: BiasFilter) -> Receipt:
        """Take it, or refuse it as long as it does not insist."""
        kind, receipt = evidence.kind, bias.update(evidence)
        before = self.state.refused.pop(kind, None)
        if receipt.accepted:
            return receipt
        refused = _against(before, evidence, receipt.innovation, bias)
        if refused.count < (self.knobs.vertical_insist if kind == VERTICAL else self.knobs.insist):
            self.state.refused[kind] = refused
            return receipt
        bias.widen(float(np.mean(receipt.innovation**2)) * np.eye(3))
        bias.update(evidence)
        return receipt._replace(accepted=True, reason=INSISTED)


def _against(before: _Refused | None, evidence: Evidence, innovation: Floats, bias: BiasFilter) -> _Refused:
    """One more of those that say the same as the first of them, else the first of others."""
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
