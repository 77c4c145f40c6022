"""Compare a calibration with the one before it, to tell whether both are of the same device. Pure."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import hypot, inf, nan

import numpy as np

from bridge.wire.messages import Calibration, Verdict
from estimator.geometry.gyro_model import AXES, SIGMAS

#: scale factors differ when they are more than this many standard deviations apart
APART = 3.0


@dataclass(frozen=True, slots=True)
class AxisCompared:
    """Scale factor and bias (rad/s) of one axis, with standard deviations, and the earlier calibration's scale factor.

    Unknown values are NaN.
    """

    axis: int
    scale: float
    scale_std: float
    bias: float
    bias_std: float
    before: float = nan
    before_std: float = nan

    @property
    def apart(self) -> float:
        """Difference of the two scale factors as a multiple of its standard deviation.

        NaN without an earlier calibration.
        """
        std = hypot(self.scale_std, self.before_std)
        difference = abs(self.scale - self.before)
        return difference / std if std else inf if difference else 0.0


def last_before(calibration: Calibration, known: Iterable[Calibration]) -> Calibration | None:
    """Return the newest accepted calibration that is older than `calibration`, or None.

    known: calibrations of the same device.
    """
    older = [c for c in known if c.verdict is Verdict.ACCEPTED and c.time_ns < calibration.time_ns]
    return max(older, key=lambda c: c.time_ns, default=None)


def compared(calibration: Calibration, before: Calibration | None) -> tuple[AxisCompared, ...]:
    """Compare each axis with the earlier calibration `before`, or None.

    Only scale factors are compared, as the biases belong to different boots.
    """
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
    """Return the axes (0, 1, 2) whose scale factor has changed by more than APART standard deviations."""
    return tuple(one.axis for one in axes if one.apart > APART)


def bias_moves(calibration: Calibration, known: Iterable[Calibration]) -> tuple[int, ...]:
    """Return the axes (0, 1, 2) whose bias has moved since the calibration before, of the same boot.

    The 95 % intervals of both biases then exclude each other.
    Two methods measure the same bias, so it has moved in between, or one calibration is wrong.
    """
    before = last_before(calibration, [c for c in known if c.boot == calibration.boot])
    if before is None or calibration.verdict is not Verdict.ACCEPTED:
        return ()
    own, then = stds(calibration), stds(before)
    return tuple(
        axis
        for axis, name in enumerate(f"bias_{axis}" for axis in AXES)
        if abs(calibration.bias[axis] - before.bias[axis]) > SIGMAS * (own.get(name, inf) + then.get(name, inf))
    )


def stds(calibration: Calibration) -> dict[str, float]:
    """Return the standard deviation of each parameter by its name: `bias_x` … in rad/s; `k_x`, `m_xy` … without unit."""
    return dict(zip(calibration.parameters, np.sqrt(np.diag(calibration.covariance)).tolist(), strict=True))
