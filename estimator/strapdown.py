"""Readings of a second or so summed up: how far the device turned, how hard it was pushed, and how both depend on the sensors.

Everything in the axes the device had when the stretch began. C(t) takes vectors of the device at t to those axes; phi is the
small rotation, in those axes, by which an error of the gyro's parameters moves the end: C_true = exp(phi) C. Source: C. Forster
et al., "On-manifold preintegration", IEEE Trans. Robotics 33 (2017), here with rates of a scaled and misaligned gyro.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.loops.span import summed

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Span:
    """A stretch without a break, `seconds` long. end (3, 3) is C at its end; push (3,) m/s the integral of C a.

    shift (3,) m: the integral of the push as it grows.
    by_bias (3, 3), by_matrix (3, 9): phi per rad/s of bias, per relative change of the matrix, M = (1 + change) matrix.
    push_by_bias, push_by_matrix, push_by_accel (3, 3), (3, 9), (3, 3): the same of push, the last per m/s² of accelerometer bias.
    way: rad turned, there and back. unrest: m/s², how far C a strays from its mean, rms.
    """

    seconds: float
    end: Floats
    push: Floats
    shift: Floats
    by_bias: Floats
    by_matrix: Floats
    push_by_bias: Floats
    push_by_matrix: Floats
    push_by_accel: Floats
    way: float
    unrest: float


def sum_up(dt: Floats, gyro: Floats, accel: Floats, matrix: Floats, bias: Floats, accel_bias: Floats) -> Span:
    """The span of n samples, each holding for dt (n,) s: gyro (n, 3) rad/s and accel (n, 3) m/s² as read."""
    scalars, vectors, by_bias, by_matrix = summed(dt, gyro, accel, matrix, bias, accel_bias)
    seconds, way, unrest = scalars.tolist()
    end, push, shift = vectors[:3], vectors[3], vectors[4]
    return Span(
        seconds=seconds,
        end=end,
        push=push,
        shift=shift,
        by_bias=-by_bias[:3] @ matrix,
        by_matrix=by_matrix[:3],
        push_by_bias=-by_bias[3:] @ matrix,
        push_by_matrix=by_matrix[3:],
        push_by_accel=-by_bias[:3],
        way=way,
        unrest=unrest,
    )
