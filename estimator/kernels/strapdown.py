"""Kernel of geometry/strapdown.py: integrates the readings of a span and their sensitivities."""

import numpy as np
from numpy.typing import NDArray

from estimator.kernels.compiled import compiled

Floats = NDArray[np.float64]

#: rows of the result of `summed`
END, PUSH, SHIFT, DRIFT, BY_BIAS, PUSH_BY_BIAS, PUSH_BY_ACCEL = (
    slice(0, 3),
    3,
    4,
    5,
    slice(6, 9),
    slice(9, 12),
    slice(12, 15),
)
BY_MATRIX, PUSH_BY_MATRIX, SCALARS, ROWS = slice(15, 24), slice(24, 33), 33, 34


@compiled("f8[:, ::1](f8[:], f8[:, :], f8[:, :], f8[:, :], f8[:], f8[:], f8[:])")
def summed(
    dt: Floats, gyro: Floats, accel: Floats, calibrated: Floats, bias: Floats, accel_bias: Floats, change: Floats
) -> Floats:
    """Rows (ROWS, 3) of a span by geometry/strapdown.py; the slopes by the matrix, (3, 9), fill nine rows.

    The matrix used is (1 + change) calibrated, with change (9,) and calibrated (3, 3). SCALARS: seconds, way, unrest.
    """
    n = len(dt)
    rate, force, carried, moved = np.empty((n, 3)), np.empty((n, 3)), np.empty((9, n)), np.empty((9, n))
    rows, matrix = np.zeros((ROWS, 3)), calibrated.copy()
    scalars, by_bias, by_matrix = rows[SCALARS], np.zeros((6, 3)), rows[15:33].reshape(6, 9)
    for r in range(3):
        for c in range(3):
            for k in range(3):
                matrix[r, c] += change[3 * r + k] * calibrated[k, c]
    seconds = way = 0.0
    # Scalars stay in registers: the attitude as a quaternion, and as matrix rows x, y and z before and after a sample.
    qw, qx, qy, qz = 1.0, 0.0, 0.0, 0.0
    xx, xy, xz, yx, yy, yz, zx, zy, zz = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    for i in range(n):
        h = dt[i]
        x, y, z = gyro[i, 0] - bias[0], gyro[i, 1] - bias[1], gyro[i, 2] - bias[2]
        u = matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z
        v = matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z
        w = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z
        rate[i, 0], rate[i, 1], rate[i, 2] = u, v, w
        speed = np.sqrt(u * u + v * v + w * w)
        seconds += h
        way += speed * h
        half = 0.5 * speed * h
        if half < 0.05:  # the series are exact here, and faster
            q = half * half
            cosine = 1 - q * (1 / 2 - q * (1 / 24 - q * (1 / 720 - q * (1 / 40320))))
            sine = 0.5 * h * (1 - q * (1 / 6 - q * (1 / 120 - q * (1 / 5040))))
        else:
            cosine, sine = np.cos(half), np.sin(half) / speed
        x, y, z = sine * u, sine * v, sine * w
        qw, qx, qy, qz = (
            qw * cosine - qx * x - qy * y - qz * z,
            qw * x + qx * cosine + qy * z - qz * y,
            qw * y - qx * z + qy * cosine + qz * x,
            qw * z + qx * y - qy * x + qz * cosine,
        )
        ax, ay, az = accel[i, 0] - accel_bias[0], accel[i, 1] - accel_bias[1], accel[i, 2] - accel_bias[2]
        now_x = qw * qw + qx * qx - qy * qy - qz * qz, 2 * (qx * qy - qw * qz), 2 * (qx * qz + qw * qy)
        now_y = 2 * (qx * qy + qw * qz), qw * qw - qx * qx + qy * qy - qz * qz, 2 * (qy * qz - qw * qx)
        now_z = 2 * (qx * qz - qw * qy), 2 * (qy * qz + qw * qx), qw * qw - qx * qx - qy * qy + qz * qz
        xx, xy, xz = 0.5 * (xx + now_x[0]), 0.5 * (xy + now_x[1]), 0.5 * (xz + now_x[2])
        yx, yy, yz = 0.5 * (yx + now_y[0]), 0.5 * (yy + now_y[1]), 0.5 * (yz + now_y[2])
        zx, zy, zz = 0.5 * (zx + now_z[0]), 0.5 * (zy + now_z[1]), 0.5 * (zz + now_z[2])
        force[i, 0] = xx * ax + xy * ay + xz * az
        force[i, 1] = yx * ax + yy * ay + yz * az
        force[i, 2] = zx * ax + zy * ay + zz * az
        carried[0, i], carried[1, i], carried[2, i] = xx * h, xy * h, xz * h
        carried[3, i], carried[4, i], carried[5, i] = yx * h, yy * h, yz * h
        carried[6, i], carried[7, i], carried[8, i] = zx * h, zy * h, zz * h
        xx, xy, xz = now_x
        yx, yy, yz = now_y
        zx, zy, zz = now_z
    scalars[0], scalars[1] = seconds, way
    # A rotation phi moves the force f by phi x f. A sample's rotation error moves all pushes from that sample on.
    ahead_x = ahead_y = ahead_z = 0.0
    for i in range(n - 1, -1, -1):
        ahead_x += force[i, 0] * dt[i]
        ahead_y += force[i, 1] * dt[i]
        ahead_z += force[i, 2] * dt[i]
        for c in range(3):
            x, y, z = carried[c, i], carried[3 + c, i], carried[6 + c, i]
            moved[c, i] = ahead_z * y - ahead_y * z
            moved[3 + c, i] = ahead_x * z - ahead_z * x
            moved[6 + c, i] = ahead_y * x - ahead_x * y
    rows[PUSH, 0], rows[PUSH, 1], rows[PUSH, 2] = ahead_x, ahead_y, ahead_z
    for r in range(3):
        for c in range(3):
            # Several independent sums at once, since each addition waits for the one before in its own sum.
            turn = turn_x = turn_y = turn_z = push = push_x = push_y = push_z = 0.0
            for i in range(n):
                one, other, x, y, z = carried[3 * r + c, i], moved[3 * r + c, i], rate[i, 0], rate[i, 1], rate[i, 2]
                turn += one
                turn_x += one * x
                turn_y += one * y
                turn_z += one * z
                push += other
                push_x += other * x
                push_y += other * y
                push_z += other * z
            by_bias[r, c], by_bias[3 + r, c] = turn, push
            by_matrix[r, 3 * c], by_matrix[r, 3 * c + 1], by_matrix[r, 3 * c + 2] = turn_x, turn_y, turn_z
            by_matrix[3 + r, 3 * c], by_matrix[3 + r, 3 * c + 1], by_matrix[3 + r, 3 * c + 2] = push_x, push_y, push_z
    rows[0], rows[1], rows[2] = (xx, xy, xz), (yx, yy, yz), (zx, zy, zz)
    square = 0.0
    for r in range(3):
        evenly, shifted, pushed, strayed, passed = rows[PUSH, r] / seconds, 0.0, 0.0, 0.0, 0.0
        for i in range(n):
            h = dt[i]
            more = force[i, r] * h
            shifted += h * (pushed + 0.5 * more)
            pushed += more
            passed += h
            stray = pushed - evenly * passed
            strayed += stray
            square += stray * stray
        rows[SHIFT, r] = shifted
        square -= strayed * strayed / n
    scalars[2] = np.sqrt(max(0.0, square) / n)
    for r in range(3):
        for c in range(3):
            rows[DRIFT, r] += rows[c, r] * (rows[PUSH, c] - rows[SHIFT, c] / seconds)
            rows[12 + r, c] = -by_bias[r, c]
            for k in range(3):
                rows[6 + r, c] -= by_bias[r, k] * matrix[k, c]
                rows[9 + r, c] -= by_bias[3 + r, k] * matrix[k, c]
    return rows
