"""Strapdown integration of a span of about a second: rotation, velocity change, and their sensitivities to sensor errors.

All results are in the sensor axes at the start of the span. C(t) (3, 3) rotates vectors from sensor axes at time t to
those axes. a (3,) is the accelerometer reading less its bias, m/s².
An error of the gyro's parameters moves the end by phi (3,), a small rotation in those axes, rad:

    C_true = exp(phi) C

Source: C. Forster et al., "On-manifold preintegration", IEEE Trans. Robotics 33 (2017), here with rates of a scaled and
misaligned gyro.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.kernels import strapdown as loop

Floats = NDArray[np.float64]
_SAME = np.zeros(9)


class Span(NamedTuple):
    """Integrals over an uninterrupted span of `seconds`, stored in the array `rows` (34, 3).

    C rotates vectors from the present sensor axes to those at the start. a is the accelerometer reading less its bias,
    m/s². phi (3,) is the small rotation of the end attitude that a parameter error causes, rad. Each name is an index
    of `rows`, defined in kernels/strapdown.py:

        END (3, 3)                                   C at the end of the span
        PUSH (3,) m/s                                integral of C a: velocity change
        SHIFT (3,) m                                 integral over time of the push so far: displacement
        DRIFT (3,) m/s                               push - shift / seconds, in sensor axes at the end
        BY_BIAS (3, 3), BY_MATRIX (9, 3)             phi (rad) per rad/s of bias, per relative change of the matrix
        PUSH_BY_BIAS (3, 3), PUSH_BY_MATRIX (9, 3)   the same sensitivities of push (m/s)
        PUSH_BY_ACCEL (3, 3)                         push (m/s) per m/s² of accelerometer bias

    The changed matrix is (1 + change) matrix.
    way: integral of the magnitude of the rate, rad.
    unrest: rms deviation of the velocity from that of a constant acceleration, m/s.
    """

    seconds: float
    way: float
    unrest: float
    rows: Floats


def sum_up(
    dt: Floats, gyro: Floats, accel: Floats, matrix: Floats, bias: Floats, accel_bias: Floats, change: Floats = _SAME
) -> Span:
    """Integrate n samples, each held for dt (n,) s, into a Span.

    gyro (n, 3) rad/s, accel (n, 3) m/s²: readings.
    matrix (3, 3), bias (3,) rad/s, accel_bias (3,) m/s²: the calibration.
    change (9,): relative change of the matrix, by rows; the matrix used is (1 + change) matrix.
    All results are in the sensor axes at the start of the span, except DRIFT.
    """
    rows = loop.summed(dt, gyro, accel, matrix, bias, accel_bias, change)
    seconds, way, unrest = rows[loop.SCALARS].tolist()
    return Span(seconds, way, unrest, rows)
