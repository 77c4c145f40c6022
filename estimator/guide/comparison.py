"""Comparison of a calibration with the previous one, to detect that devices were exchanged. Pure."""

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
    """Scale factor and bias of one axis, and the scale factor of the earlier calibration.

    axis: 0, 1, 2. scale, before: scale factors now and before, without unit. bias: rad/s. scale_std, before_std,
    bias_std: their standard deviations, in the same units. Unknown values are NaN.
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
        """Absolute difference of the two scale factors, in standard deviations of the difference.

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
    """Return scale factor and bias of each axis, with the scale factor of the earlier calibration `before`.

    before: None if there is none; its scale factors are then NaN. Only scale factors are compared, since a bias may
    differ in each boot.
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
    """Return the axes (0, 1, 2) whose scale factor has changed significantly.

    The change must exceed APART = 3 times its standard deviation.
    """
    return tuple(one.axis for one in axes if one.apart > APART)


def bias_moves(calibration: Calibration, known: Iterable[Calibration]) -> tuple[int, ...]:
    """Return the axes (0, 1, 2) whose bias differs from the previous accepted calibration of the same boot.

    known: calibrations of the device. A bias differs if the 95 % intervals of the two values do not overlap. Then the
    bias has changed in between, or one calibration is wrong.
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
    """Return the standard deviation of each parameter of a calibration, by the parameter's name.

    `bias_x` … are in rad/s. `k_x` … (scale factors) and `m_xy` … (other elements of the matrix) have no unit.
    """
    return dict(zip(calibration.parameters, np.sqrt(np.diag(calibration.covariance)).tolist(), strict=True))
