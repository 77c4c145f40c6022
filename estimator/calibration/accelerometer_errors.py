"""Error model of an accelerometer: gravity = shape (reading - bias), all vectors (3,) in m/s².

`shape` (3, 3) is symmetric and close to the identity. A symmetric shape prefers no axis: its frame is the orthogonal
frame nearest to the accelerometer's axes. The full 3x3 gyro matrix refers to this frame.
`PARAMETERS` names the nine errors: bias (3) m/s², scale error (3) relative, shear (3) rad.
"""

from dataclasses import dataclass

import numpy as np

from estimator.calibration.capture import Floats

G = 9.80665
PARAMETERS = (
    *("accel_bias_x", "accel_bias_y", "accel_bias_z"),
    *("accel_scale_x", "accel_scale_y", "accel_scale_z"),
    *("accel_shear_yz", "accel_shear_xz", "accel_shear_xy"),
)
N = len(PARAMETERS)
#: (9, 3, 3) slope of the shape by each parameter
_SHAPES = np.zeros((N, 3, 3))
for _axis in range(3):
    _SHAPES[3 + _axis, _axis, _axis] = 1.0
for _p, (_i, _j) in enumerate(((1, 2), (0, 2), (0, 1))):
    _SHAPES[6 + _p, _i, _j] = _SHAPES[6 + _p, _j, _i] = 1.0


@dataclass(frozen=True, slots=True)
class AccelKnobs:
    """Prior standard deviations of an accelerometer's errors, all of mean zero.

    bias: m/s². scale: relative. shear: rad, between two axes.
    """

    #: m/s²; 60 mg is the worst of a datasheet's zero-g offsets
    bias: float = 0.5
    #: relative; includes the deviation of local gravity from 9.80665 by 0.3 %
    scale: float = 0.03
    #: rad between two axes
    shear: float = 0.005

    def std(self) -> Floats:
        """Prior standard deviations (9,), ordered as PARAMETERS: bias (3) m/s², scale (3) relative, shear (3) rad."""
        return np.repeat([self.bias, self.scale, self.shear], 3)


def measured(accel: Floats, errors: Floats) -> tuple[Floats, Floats, Floats]:
    """Correct a mean accelerometer reading to gravity (3,) m/s², with the derivatives of that gravity.

    accel (3,): mean reading, m/s², in sensor axes.
    errors (9,): in the order and units of PARAMETERS.
    Returns gravity (3,), its derivatives (3, 9) by the errors, and its derivatives (3, 3) by the reading.
    """
    shape = np.eye(3) + np.tensordot(errors, _SHAPES, axes=1)
    from_bias = accel - errors[:3]
    slope = np.column_stack([-shape, (_SHAPES[3:] @ from_bias).T])
    return shape @ from_bias, slope, shape
