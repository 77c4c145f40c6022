"""A calibration beside the one before it: is it the same device? Pure."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import hypot, inf, nan

import numpy as np

from bridge.wire.messages import Calibration, Verdict
from estimator.geometry.gyro_model import AXES

#: standard deviations of their difference beyond which two are not the same
APART = 3.0


@dataclass(frozen=True, slots=True)
class AxisCompared:
    """One axis: scale factor and bias (rad/s) with their standard deviations, NaN when not known; and the scale before."""

    axis: int
    scale: float
    scale_std: float
    bias: float
    bias_std: float
    before: float = nan
    before_std: float = nan

    @property
    def apart(self) -> float:
        """How many standard deviations the two scales differ by; NaN when there was none before."""
        std = hypot(self.scale_std, self.before_std)
        difference = abs(self.scale - self.before)
        return difference / std if std else inf if difference else 0.0


def last_before(calibration: Calibration, known: Iterable[Calibration]) -> Calibration | None:
    """The newest accepted one of the device that is older."""
    older = [c for c in known if c.verdict is Verdict.ACCEPTED and c.time_ns < calibration.time_ns]
    return max(older, key=lambda c: c.time_ns, default=None)


def compared(calibration: Calibration, before: Calibration | None) -> tuple[AxisCompared, ...]:
    """Each axis of it; its bias is of another boot than the one before, so that only the scales are compared."""
    std = stds(calibration)
    then = {} if before is None else stds(before)
    return tuple(
        AxisCompared(
            axis,
            float(calibration.matrix[axis, axis]),
            std.get(f"k_{name}", nan),
            float(calibration.bias[axis]),
            std.get(f"bias_{name}", nan),
            nan if before is None else float(before.matrix[axis, axis]),
            then.get(f"k_{name}", nan),
        )
        for axis, name in enumerate(AXES)
    )


def differing(axes: Iterable[AxisCompared]) -> tuple[int, ...]:
    """The axes whose scale is not what it was."""
    return tuple(one.axis for one in axes if one.apart > APART)


def stds(calibration: Calibration) -> dict[str, float]:
    """Standard deviation of each parameter by its name."""
    return dict(zip(calibration.parameters, np.sqrt(np.diag(calibration.covariance)).tolist(), strict=True))
