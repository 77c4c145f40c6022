"""The loop behind strapdown.py."""

import numpy as np
from numpy.typing import NDArray

from estimator.loops.compiled import compiled

Floats = NDArray[np.float64]

#: rows of `summed`
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
    """(ROWS, 3): the parts of a span by strapdown.py, what is by the matrix (3, 9) in nine rows.

    The matrix is (1 + change) calibrated, of nine numbers and (3, 3). SCALARS: seconds, way, unrest.
    """
    n = len(dt)
    rate, force, carried, moved = np.empty((n, 3)), np.empty((n, 3)), np.empty((9, n)), np.empty((9, n))
    before, after = np.eye(3), np.eye(3)
    rows, matrix = np.zeros((ROWS, 3)), calibrated.copy()
    scalars, by_bias, by_matrix = rows[SCALARS], np.zeros((6, 3)), rows[15:33].reshape(6, 9)
    for r in range(3):
        for c in range(3):
            for k in range(3):
                matrix[r, c] += change[3 * r + k] * calibrated[k, c]
    qw, qx, qy, qz = 1.0, 0.0, 0.0, 0.0
    for i in range(n):
        h = dt[i]
        for r in range(3):
            rate[i, r] = 0.0
            for c in range(3):
                rate[i, r] += matrix[r, c] * (gyro[i, c] - bias[c])
        # The next attitude, by the quaternion of the step.
        speed = np.sqrt(rate[i, 0] ** 2 + rate[i, 1] ** 2 + rate[i, 2] ** 2)
        scalars[0] += h
        scalars[1] += speed * h
        half = speed * h / 2
        if half < 0.05:  # the series are exact, and quicker
            q = half * half
            w = 1 - q * (1 / 2 - q * (1 / 24 - q * (1 / 720 - q * (1 / 40320))))
            sine = 0.5 * h * (1 - q * (1 / 6 - q * (1 / 120 - q * (1 / 5040))))
        else:
            w, sine = np.cos(half), np.sin(half) / speed
        x, y, z = sine * rate[i, 0], sine * rate[i, 1], sine * rate[i, 2]
        qw, qx, qy, qz = (
            qw * w - qx * x - qy * y - qz * z,
            qw * x + qx * w + qy * z - qz * y,
            qw * y - qx * z + qy * w + qz * x,
            qw * z + qx * y - qy * x + qz * w,
        )
        after[0, 0], after[0, 1], after[0, 2] = (
            qw * qw + qx * qx - qy * qy - qz * qz,
            2 * (qx * qy - qw * qz),
            2 * (qx * qz + qw * qy),
        )
        after[1, 0], after[1, 1], after[1, 2] = (
            2 * (qx * qy + qw * qz),
            qw * qw - qx * qx + qy * qy - qz * qz,
            2 * (qy * qz - qw * qx),
        )
        after[2, 0], after[2, 1], after[2, 2] = (
            2 * (qx * qz - qw * qy),
            2 * (qy * qz + qw * qx),
            qw * qw - qx * qx - qy * qy + qz * qz,
        )
        for r in range(3):
            force[i, r] = 0.0
            for c in range(3):
                mid = 0.5 * (before[r, c] + after[r, c])
                force[i, r] += mid * (accel[i, c] - accel_bias[c])
                before[r, c] = after[r, c]
                carried[3 * r + c, i] = mid * h
    # A rotation phi moves the force f by phi x f, and lasts: what a sample turns, all pushes from it on are moved by.
    ahead = rows[PUSH]
    for i in range(n - 1, -1, -1):
        for r in range(3):
            ahead[r] += force[i, r] * dt[i]
        for c in range(3):
            x, y, z = carried[c, i], carried[3 + c, i], carried[6 + c, i]
            moved[c, i] = ahead[2] * y - ahead[1] * z
            moved[3 + c, i] = ahead[0] * z - ahead[2] * x
            moved[6 + c, i] = ahead[1] * x - ahead[0] * y
    for r in range(3):
        for c in range(3):
            # One sum after the other would wait for each addition.
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
    pushed, strayed, square, passed = np.zeros(3), np.zeros(3), 0.0, 0.0
    for i in range(n):
        passed += dt[i]
        for r in range(3):
            rows[SHIFT, r] += dt[i] * (pushed[r] + 0.5 * force[i, r] * dt[i])
            pushed[r] += force[i, r] * dt[i]
            stray = pushed[r] - rows[PUSH, r] * passed / scalars[0]
            strayed[r] += stray
            square += stray * stray
    for r in range(3):
        square -= strayed[r] ** 2 / n
    scalars[2] = np.sqrt(max(0.0, square) / n)
    for r in range(3):
        for c in range(3):
            rows[r, c] = after[r, c]
            rows[DRIFT, r] += after[c, r] * (rows[PUSH, c] - rows[SHIFT, c] / scalars[0])
            rows[12 + r, c] = -by_bias[r, c]
            for k in range(3):
                rows[6 + r, c] -= by_bias[r, k] * matrix[k, c]
                rows[9 + r, c] -= by_bias[3 + r, k] * matrix[k, c]
    return rows
