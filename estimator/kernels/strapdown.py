"""Kernel of geometry/strapdown.py: integrates the readings of a span, and their sensitivities to sensor errors.

A span is an uninterrupted stretch of about one second. Its push is the integral of the force (accelerometer reading
less its bias) over time, a velocity change in m/s.
"""

import numpy as np

from estimator.kernels.compiled import Floats, compiled

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


def rates(gyro: Floats, bias: Floats, calibrated: Floats, change: Floats) -> tuple[Floats, Floats]:
    """Rates (n, 3), rad/s, from gyro readings (n, 3), rad/s, and the matrix (3, 3) used for them.

    bias (3,): rad/s. calibrated (3, 3): gyro matrix. change (9,): relative change of the gyro matrix, by rows.
    The matrix used is (1 + change) calibrated; rate = matrix (reading - bias).
    """
    rate, matrix = np.empty(gyro.shape), calibrated.copy()
    for r in range(3):
        for c in range(3):
            for k in range(3):
                matrix[r, c] += change[3 * r + k] * calibrated[k, c]
    for i in range(len(gyro)):
        x, y, z = gyro[i, 0] - bias[0], gyro[i, 1] - bias[1], gyro[i, 2] - bias[2]
        for r in range(3):
            rate[i, r] = matrix[r, 0] * x + matrix[r, 1] * y + matrix[r, 2] * z
    return rate, matrix


def half_turn(speed: float, h: float) -> tuple[float, float]:
    """Return cos(a / 2), and sin(a / 2) / speed in s, for the angle a = speed h turned in h seconds at `speed`, rad/s."""
    half = 0.5 * speed * h
    if half >= 0.05:
        return np.cos(half), np.sin(half) / speed
    q = half * half  # the series are exact here, and faster
    cosine = 1 - q * (1 / 2 - q * (1 / 24 - q * (1 / 720 - q * (1 / 40320))))
    return cosine, 0.5 * h * (1 - q * (1 / 6 - q * (1 / 120 - q * (1 / 5040))))


def turned(dt: Floats, rate: Floats, force: Floats, carried: Floats, end: Floats) -> tuple[float, float]:
    """Integrate the attitude over n samples; return the span's length (s), and the angle turned in total (rad).

    dt (n,): s. rate (n, 3): rad/s.
    force (n, 3): m/s², changed in place from sensor axes to axes of the span's start.
    carried (9, n), written: mean attitude in each sample times its dt, s.
    end (3, 3), written: the last attitude, sensor axes to axes of the start.
    """
    seconds = way = 0.0
    # Scalars stay in registers: the attitude as a quaternion, and as matrix rows x, y and z before and after a sample.
    qw, qx, qy, qz = 1.0, 0.0, 0.0, 0.0
    xx, xy, xz, yx, yy, yz, zx, zy, zz = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    for i in range(len(dt)):
        h, u, v, w = dt[i], rate[i, 0], rate[i, 1], rate[i, 2]
        speed = np.sqrt(u * u + v * v + w * w)
        seconds += h
        way += speed * h
        cosine, sine = half_turn(speed, h)
        x, y, z = sine * u, sine * v, sine * w
        qw, qx, qy, qz = (
            qw * cosine - qx * x - qy * y - qz * z,
            qw * x + qx * cosine + qy * z - qz * y,
            qw * y - qx * z + qy * cosine + qz * x,
            qw * z + qx * y - qy * x + qz * cosine,
        )
        ax, ay, az = force[i, 0], force[i, 1], force[i, 2]
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
    end[0], end[1], end[2] = (xx, xy, xz), (yx, yy, yz), (zx, zy, zz)
    return seconds, way


def moved_ahead(dt: Floats, force: Floats, carried: Floats, push: Floats) -> Floats:
    """Velocity changes (9, n) that a rate error in each sample causes, m/s per rad/s.

    dt (n,): s. force (n, 3): m/s², in axes of the span's start. carried (9, n): result of `turned`.
    push (3,), written: the sum of force times dt, m/s.
    """
    # A rotation phi moves the force f by phi x f. A sample's rotation error moves all pushes from that sample on.
    moved = np.empty(carried.shape)
    ahead_x = ahead_y = ahead_z = 0.0
    for i in range(len(dt) - 1, -1, -1):
        ahead_x += force[i, 0] * dt[i]
        ahead_y += force[i, 1] * dt[i]
        ahead_z += force[i, 2] * dt[i]
        for c in range(3):
            x, y, z = carried[c, i], carried[3 + c, i], carried[6 + c, i]
            moved[c, i] = ahead_z * y - ahead_y * z
            moved[3 + c, i] = ahead_x * z - ahead_z * x
            moved[6 + c, i] = ahead_y * x - ahead_x * y
    push[0], push[1], push[2] = ahead_x, ahead_y, ahead_z
    return moved


def slopes(carried: Floats, moved: Floats, rate: Floats, by_bias: Floats, by_matrix: Floats) -> None:
    """Write the derivatives of rotation (rad) and velocity change (m/s) by a constant rate error and by the matrix.

    carried, moved (9, n): results of `turned` and `moved_ahead`. rate (n, 3): rad/s.
    by_bias (6, 3), by_matrix (6, 9): written. Rows: rotation (3), then velocity change (3).
    Columns of by_bias: rate error about each sensor axis, per rad/s. Columns of by_matrix: elements of the relative
    change, by rows.
    """
    n = len(rate)
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


def strayed(dt: Floats, force: Floats, push: Floats, seconds: float, shift: Floats) -> float:
    """Unrest of a span, m/s: rms deviation of the velocity from that of a constant acceleration.

    dt (n,): s. force (n, 3) m/s², push (3,) m/s: in axes of the span's start. seconds: length of the span, s.
    shift (3,), written: displacement from the velocity change, m: integral over time of the push accumulated so far.
    """
    n, square = len(dt), 0.0
    for r in range(3):
        evenly, shifted, pushed, strays, passed = push[r] / seconds, 0.0, 0.0, 0.0, 0.0
        for i in range(n):
            h = dt[i]
            more = force[i, r] * h
            shifted += h * (pushed + 0.5 * more)
            pushed += more
            passed += h
            stray = pushed - evenly * passed
            strays += stray
            square += stray * stray
        shift[r] = shifted
        square -= strays * strays / n
    return float(np.sqrt(max(0.0, square) / n))


@compiled(
    "f8[:, ::1](f8[:], f8[:, :], f8[:, :], f8[:, :], f8[:], f8[:], f8[:])",
    *(rates, half_turn, turned, moved_ahead, slopes, strayed),
)
def summed(
    dt: Floats, gyro: Floats, accel: Floats, calibrated: Floats, bias: Floats, accel_bias: Floats, change: Floats
) -> Floats:
    """Integrate a span of n samples into rows (ROWS, 3): end attitude, velocity change, and sensitivities to sensor errors.

    The rows are described by the class Span in geometry/strapdown.py; ROWS is 34.
    dt (n,) s, gyro (n, 3) rad/s, accel (n, 3) m/s²: samples.
    calibrated (3, 3), bias (3,) rad/s, accel_bias (3,) m/s²: calibration. change (9,): relative change of the matrix,
    by rows. The matrix used is (1 + change) calibrated.
    The last row (SCALARS) holds seconds (s), total angle turned (rad), and unrest (m/s).
    """
    rows, force, carried = np.zeros((ROWS, 3)), np.empty(accel.shape), np.empty((9, len(dt)))
    scalars, by_bias, by_matrix = rows[SCALARS], np.zeros((6, 3)), rows[15:33].reshape(6, 9)
    rate, matrix = rates(gyro, bias, calibrated, change)
    for i in range(len(dt)):
        for c in range(3):
            force[i, c] = accel[i, c] - accel_bias[c]
    scalars[0], scalars[1] = turned(dt, rate, force, carried, rows[:3])
    moved = moved_ahead(dt, force, carried, rows[PUSH])
    slopes(carried, moved, rate, by_bias, by_matrix)
    scalars[2] = strayed(dt, force, rows[PUSH], scalars[0], rows[SHIFT])
    for r in range(3):
        for c in range(3):
            rows[DRIFT, r] += rows[c, r] * (rows[PUSH, c] - rows[SHIFT, c] / scalars[0])
            rows[12 + r, c] = -by_bias[r, c]
            for k in range(3):
                rows[6 + r, c] -= by_bias[r, k] * matrix[k, c]
                rows[9 + r, c] -= by_bias[3 + r, k] * matrix[k, c]
    return rows
