"""Strapdown integration of a span of about a second: rotation, velocity change, and their sensitivities to sensor errors.

All results are in the axes the device had at the beginning of the span. C(t) takes vectors of the device at time t to
those axes. phi is the small rotation, in those axes, by which an error of the gyro's parameters moves the end:
C_true = exp(phi) C.
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
    """Integrals over an uninterrupted span of `seconds`, in rows of kernels/strapdown.py.

        END (3, 3)                                   C at the end of the span
        PUSH (3,) m/s                                integral of C a: velocity change
        SHIFT (3,) m                                 integral of the growing push over time
        DRIFT (3,) m/s                               push - shift / seconds, in axes of the end
        BY_BIAS (3, 3), BY_MATRIX (9, 3)             phi per rad/s of bias, per relative change of the matrix
        PUSH_BY_BIAS (3, 3), PUSH_BY_MATRIX (9, 3)   the same sensitivities of push
        PUSH_BY_ACCEL (3, 3)                         push per m/s² of accelerometer bias

    The changed matrix is M = (1 + change) matrix.

    way: rad turned in total, in both directions. unrest: m/s rms, deviation of the velocity from a constant push.
    """

    seconds: float
    way: float
    unrest: float
    rows: Floats


def sum_up(
    dt: Floats, gyro: Floats, accel: Floats, matrix: Floats, bias: Floats, accel_bias: Floats, change: Floats = _SAME
) -> Span:
    """Integrate n samples, each held for dt (n,) s, into a Span.

    gyro (n, 3) rad/s and accel (n, 3) m/s² are readings; matrix (3, 3), bias (3,), accel_bias (3,) are the calibration.
    change (9,): relative error of the matrix; the matrix used is (1 + change) matrix.
    """
    rows = loop.summed(dt, gyro, accel, matrix, bias, accel_bias, change)
    seconds, way, unrest = rows[loop.SCALARS].tolist()
    return Span(seconds, way, unrest, rows)
