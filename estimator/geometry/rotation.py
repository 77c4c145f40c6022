"""Attitude from angular rate: products of rotations on SO(3).

Attitudes are 3x3 matrices. They rotate body vectors into the frame in which the body started.
Internally a rotation is a unit quaternion w + xi + yj + zk, stored as two complex numbers, w + xi and y + zi. The
product of two arrays of quaternions then takes four array multiplications.
"""

from math import atan2, hypot

import numpy as np
import scipy
from numpy.typing import NDArray

Floats = NDArray[np.float64]

Complex = NDArray[np.complex128]

#: steps per block: blocks run side by side, the steps of a block one after the other
_BLOCK = 8
#: up to this many steps of a single rotation, Python numbers are faster than arrays
_FEW = 128


def intervals(time: Floats) -> Floats:
    """Sample intervals (n,), s, of sample times (n,), s: a sample holds over the interval that ends at it.

    The first sample has no interval before it and gets the median interval.
    """
    steps = np.diff(time)
    first = np.median(steps) if len(steps) else 0.0
    return np.concatenate([[first], steps])


def attitudes(rate: Floats, dt: Floats) -> Floats:
    """Attitudes (…, n + 1, 3, 3) from rates (…, n, 3), rad/s, held for dt (…, n), s, starting at the identity.

    Method: products of Rodrigues rotations. Leading axes are independent turns, computed together.
    """
    return chained(rate * dt[..., None])


def chained(steps: Floats) -> Floats:
    """Attitudes (…, n + 1, 3, 3) after 0, 1, 2 … n rotation steps (…, n, 3): rotation vectors in rad, body axes."""
    result = np.empty((*steps.shape[:-2], steps.shape[-2] + 1, 3, 3))
    result[..., 0, :, :] = np.eye(3)
    many = steps.ndim > 2
    samples_first, after = (np.moveaxis(steps, -2, 0), np.moveaxis(result, -3, 0)) if many else (steps, result)
    _matrices(*_products(*_quaternions(samples_first)), out=after[1:])
    return result


def coned(steps: Floats) -> Floats:
    """Coning correction of rotation steps (…, n, 3), rad: adds the effect of a rotation axis that moves within a step.

    Each step is the integral of the rate over its interval. The rate is assumed linear over a step and the step before:
    corrected step = step + 1/12 (step before) x step.
    Source: P. G. Savage, "Strapdown inertial navigation integration algorithm design part 1: attitude algorithms", J.
    Guidance Control Dynamics 21 (1998), the coning algorithm of second order.
    """
    result = steps.copy()
    result[..., 1:, :] += np.cross(steps[..., :-1, :], steps[..., 1:, :]) / 12
    return result


def log(attitude: Floats) -> Floats:
    """Rotation vectors (…, 3), rad, of attitudes (…, 3, 3); their length is 0 to pi."""
    vectors: Floats = scipy.spatial.transform.Rotation.from_matrix(attitude.reshape(-1, 3, 3)).as_rotvec()
    return vectors.reshape(attitude.shape[:-1])


def cross_matrix(vector: Floats) -> Floats:
    """Cross-product matrices (…, 3, 3) of vectors (…, 3): the matrix of v times w is v x w. The unit is that of v."""
    crossed = np.zeros((*vector.shape, 3))
    crossed[..., 2, 1], crossed[..., 0, 2], crossed[..., 1, 0] = vector[..., 0], vector[..., 1], vector[..., 2]
    crossed[..., 1, 2], crossed[..., 2, 0], crossed[..., 0, 1] = -vector[..., 0], -vector[..., 1], -vector[..., 2]
    return crossed


def angle_between(one: Floats, other: Floats) -> float:
    """Angle between two vectors (3,) of any length, rad, 0 to pi."""
    (a, b, c), (x, y, z) = one.tolist(), other.tolist()
    return atan2(hypot(b * z - c * y, c * x - a * z, a * y - b * x), a * x + b * y + c * z)


def _products(a: Complex, b: Complex) -> tuple[Complex, Complex]:
    """Running products of quaternions (n, …): q0, q0 q1, q0 q1 q2 and so on.

    Blocks are multiplied side by side. Each block is then multiplied by the product of all blocks before it.
    """
    n = len(a)
    blocks = -(-n // _BLOCK)
    if a.ndim == 1 and n <= _FEW:
        return _one_by_one(a.tolist(), b.tolist())
    if n <= 2 * _BLOCK:
        for i in range(1, n):
            a[i], b[i] = _multiply(a[i - 1], b[i - 1], a[i], b[i])
        return a, b
    filled = np.zeros((2, blocks * _BLOCK, *a.shape[1:]), complex)
    filled[0, :n], filled[0, n:], filled[1, :n] = a, 1.0, b
    # The position within a block comes first, so that each step below reads memory in order.
    run = np.ascontiguousarray(filled.reshape(2, blocks, _BLOCK, *a.shape[1:]).swapaxes(1, 2))
    for i in range(1, _BLOCK):
        run[:, i] = _multiply(*run[:, i - 1], *run[:, i])
    before = _products(*run[:, -1, :-1].copy())
    run[:, :, 1:] = _multiply(*before, *run[:, :, 1:])
    whole = run.swapaxes(1, 2).reshape(filled.shape)[:, :n]
    return whole[0], whole[1]


def _one_by_one(a: list[complex], b: list[complex]) -> tuple[Complex, Complex]:
    """Running products of a few quaternions, in Python numbers."""
    for i in range(1, len(a)):
        w, x, y, z = a[i - 1], b[i - 1], a[i], b[i]
        a[i], b[i] = w * y - x * z.conjugate(), w * z + x * y.conjugate()
    return np.array(a), np.array(b)


def _multiply(a: Complex, b: Complex, c: Complex, d: Complex) -> tuple[Complex, Complex]:
    """Quaternion product (a + bj)(c + dj), using jz = conj(z) j."""
    return a * c - b * np.conj(d), a * d + b * np.conj(c)


def _quaternions(steps: Floats) -> tuple[Complex, Complex]:
    """Quaternions of rotation vectors (…, 3)."""
    # The small constant avoids a division by zero where there is no rotation.
    half = np.sqrt(np.einsum("...i,...i", steps, steps) + 1e-300) / 2
    sine = np.sin(half) / (2 * half)
    x, y, z = steps[..., 0], steps[..., 1], steps[..., 2]
    return np.cos(half) + 1j * (sine * x), sine * y + 1j * (sine * z)


def _matrices(a: Complex, b: Complex, out: Floats) -> None:
    """Write the rotation matrices (…, 3, 3) of quaternions to `out`."""
    w, x, y, z = a.real, a.imag, b.real, b.imag
    same, swapped = a * a, b * b
    right, left = 2 * a * np.conj(b), 2 * a * b
    # a a = (ww - xx) + 2wx i, b b = (yy - zz) + 2yz i, a b* = (wy + xz) + (xy - wz) i, a b = (wy - xz) + (wz + xy) i
    out[..., 0, 0] = w * w + x * x - y * y - z * z
    out[..., 0, 1] = right.imag
    out[..., 0, 2] = right.real
    out[..., 1, 0] = left.imag
    out[..., 2, 0] = -left.real
    out[..., 1, 1] = same.real + swapped.real
    out[..., 2, 2] = same.real - swapped.real
    out[..., 1, 2] = swapped.imag - same.imag
    out[..., 2, 1] = swapped.imag + same.imag
