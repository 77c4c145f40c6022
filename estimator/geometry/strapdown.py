"""Readings of a second or so summed up: how far the device turned, how hard it was pushed, and how both depend on the sensors.

Everything in the axes the device had when the stretch began. C(t) takes vectors of the device at t to those axes; phi is the
small rotation, in those axes, by which an error of the gyro's parameters moves the end: C_true = exp(phi) C. Source: C. Forster
et al., "On-manifold preintegration", IEEE Trans. Robotics 33 (2017), here with rates of a scaled and misaligned gyro.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.kernels import strapdown as loop

Floats = NDArray[np.float64]
_SAME = np.zeros(9)


class Span(NamedTuple):
    """A stretch without a break, `seconds` long, in rows of kernels/strapdown.py.

    END (3, 3) is C at its end; PUSH (3,) m/s the integral of C a; SHIFT (3,) m the integral of the push as it grows; DRIFT (3,)
    m/s, push - shift / seconds in axes of the end.
    BY_BIAS (3, 3), BY_MATRIX (9, 3): phi per rad/s of bias, per relative change of the matrix, M = (1 + change) matrix.
    PUSH_BY_BIAS, PUSH_BY_MATRIX, PUSH_BY_ACCEL (3, 3), (9, 3), (3, 3): the same of push, the last per m/s² of accelerometer bias.
    way: rad turned, there and back. unrest: m/s, how far the velocity strays from an even push, rms.
    """

    seconds: float
    way: float
    unrest: float
    rows: Floats


def sum_up(
    dt: Floats, gyro: Floats, accel: Floats, matrix: Floats, bias: Floats, accel_bias: Floats, change: Floats = _SAME
) -> Span:
    """The span of n samples, each holding for dt (n,) s: gyro (n, 3) rad/s and accel (n, 3) m/s² as read.

    change (9,): what the matrix (3, 3) is really like is (1 + change) matrix.
    """
    rows = loop.summed(dt, gyro, accel, matrix, bias, accel_bias, change)
    seconds, way, unrest = rows[loop.SCALARS].tolist()
    return Span(seconds, way, unrest, rows)
