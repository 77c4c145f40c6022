"""Quaternion arithmetic of the simulator: scalar first (w, x, y, z), sensor to earth, arrays (n, 4).

Rotation vectors are (n, 3) in rad. In a product a b, rotation b follows rotation a, about body axes.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def from_rotvec(rotvec: Array) -> Array:
    """Convert rotation vectors (n, 3), rad, of any length to unit quaternions (n, 4), scalar first."""
    half = np.linalg.norm(rotvec, axis=1) / 2
    # np.sinc(x) is sin(πx)/(πx), exact at zero.
    return np.column_stack([np.cos(half), 0.5 * np.sinc(half / np.pi)[:, None] * rotvec])


def to_rotvec(q: Array) -> Array:
    """Convert unit quaternions (n, 4), scalar first, to the shortest rotation vectors (n, 3), rad.

    The result has full precision near zero.
    """
    q = np.where(q[:, :1] < 0, -q, q)
    sine = np.linalg.norm(q[:, 1:], axis=1)
    # angle / sin(angle / 2), which tends to 2 at zero
    ratio = np.divide(2 * np.arctan2(sine, q[:, 0]), sine, out=np.full_like(sine, 2.0), where=sine > 0)
    return np.asarray(ratio[:, None] * q[:, 1:])


def multiply(a: Array, b: Array) -> Array:
    """Return the quaternion products a b, (n, 4), scalar first: rotation b follows rotation a, about body axes.

    a, b (n, 4): either may have one row.
    """
    # Bracketed so that the inverse of q times q is exactly the identity: a still device has a rate of exactly zero.
    aw, ax, ay, az = a.T
    bw, bx, by, bz = b.T
    return np.column_stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            (aw * bx + ax * bw) + (ay * bz - az * by),
            (aw * by + ay * bw) + (az * bx - ax * bz),
            (aw * bz + az * bw) + (ax * by - ay * bx),
        ]
    )


def conjugate(q: Array) -> Array:
    """Return the conjugates (n, 4) of unit quaternions (n, 4), scalar first: the inverse rotations."""
    return np.asarray(q * np.array([1.0, -1.0, -1.0, -1.0]))


def rotate(q: Array, vector: Array) -> Array:
    """Rotate vectors (n, 3) from sensor axes to earth axes; the unit stays.

    q (n, 4): attitudes, unit quaternions wxyz, sensor to earth. Either argument may have one row.
    """
    across = 2 * np.cross(q[:, 1:], vector)
    return np.asarray(vector + q[:, :1] * across + np.cross(q[:, 1:], across))


def up_in_body(q: Array) -> Array:
    """Return the unit vector that points up, (n, 3), in sensor axes: the third row of each rotation matrix.

    q (n, 4): attitudes, unit quaternions wxyz, sensor to earth.
    """
    w, x, y, z = q.T
    return np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
