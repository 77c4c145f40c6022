"""Kernel of orientation/attitude.py: integrates the attitudes of many devices over their samples in one call.

Letters:

    q     attitude, sensor to earth (z up), as a quaternion w x y z
    f     specific force (3) in earth axes, m/s²
    v     horizontal velocity (2) that f gives, m/s
    phi   small rotation (3) in earth axes from the estimated attitude to the true one, rad
    g     9.80665 m/s²

A tilt phi appears as an acceleration g (phi_y, -phi_x), so v grows without limit. The velocity of a wearer is bounded,
so it is measured as zero.
"""

import numpy as np
from numpy.typing import NDArray

from estimator.kernels.compiled import Floats, compiled

Wholes = NDArray[np.int64]

#: parts of a device's state: device time, s, NaN before the first sample; quaternion; velocity, m/s; velocity over the last
#: seconds only, m/s, and its mean square; covariance of tilt and velocity that the gain is computed from (00, 01, 11); the
#: same from noise alone; heading variance that no parameter below explains
TIME, QUAT, VELOCITY, SWING, UNREST, GAIN, NOISE, HEADING = 0, 1, 5, 7, 9, 10, 13, 16
#: sensitivity (5, 15) of phi (3) and v (2) to gyro bias (3), relative change of the matrix (9, row by row), accelerometer
#: bias (3); variances (15) they are meant for; time since which the bias has walked; last rate; usual interval, s; covariance
#: of phi (xx, xy, xz, yy, yz, zz), as of the last sample; number of the next sample, and of that at which the heading was zero
BY, VAR, SINCE, RATE, INTERVAL, COV, NEXT, ZERO, SIZE = 17, 92, 107, 108, 111, 112, 118, 119, 120
#: parts of what is known of the sensors: matrix and bias; standard deviations (15) of bias, matrix and accelerometer bias; noise;
#: of the bias' flicker, and its random walk, rad/s per root second; bias and scale of the accelerometer
KNOWN_STD, KNOWN_ACCEL_STD, KNOWN_NOISE, KNOWN_FLICKER, KNOWN_WALK, KNOWN_ACCEL, KNOWN = 12, 24, 27, 30, 31, 32, 38
#: columns of the result: quaternion; acceleration without gravity, earth axes, m/s²
RESULT_ACCEL, WIDTH = 4, 7
#: columns of the trace for the smoother: tilt and velocity covariance before and after the update; correction of phi x and y,
#: and of v; interval, s, 0 where the chain is broken
TRACE = 11


@compiled("void(f8[:, ::1], i8[:], f8[:, :], i8[:], f8[:, ::1], f8[:], f8[:, ::1], f8[:, ::1], f8[:, ::1])")
def carried(
    states: Floats,
    which: Wholes,
    rows: Floats,
    counts: Wholes,
    known: Floats,
    knobs: Floats,
    out: Floats,
    cov: Floats,
    trace: Floats,
) -> None:
    """Integrate attitudes of k devices over n samples, in place in `states`; write the results to `out` (n, 7).

    states (k, 120), changed in place: one row per device. A row has time (s), quaternion, velocity (m/s), covariances,
    and sensitivities to sensor errors, in the order of the constants of this module.
    rows (n, 9): device time (s), gyro (3, rad/s), accelerometer (3, m/s²), clipped, temperature (°C).
    which, counts (m,): the first counts[0] rows belong to device which[0], the next counts[1] to device which[1], and
        so on.
    known (m, 38): for each of the m groups of rows, the sensor errors, as packed by the function `known` in
        orientation/attitude.py.

    knobs (11,):

        0, 1   standard deviation of the wearer's mean velocity, m/s; the same for each m/s of motion
        2      time over which motion is measured, s
        3, 4   gyro errors, rad per root second: for each rad/s, and constant
        5      accelerometer noise, m/s per root second
        6, 7   standard deviations of the first tilt, rad, and of the first velocity, m/s
        8      correlation time of the bias instability, s
        9      error of the rate where samples are missing, rad/s
        10     gap in the samples after which the rotation is unknown, s

    out (n, 7), written: quaternion sensor to earth (4), and acceleration without gravity in earth axes (3, m/s²).
    cov, written: covariance of phi (xx, xy, xz, yy, yz, zz), rad². It is (n, 6) for every sample, or (m, 6) for the
        last row of each group.
    trace (n, 11), written, for `smoothed`; or (0, 11) for no trace.
    """
    g, limit = 9.80665, np.pi**2 / 3  # the variance of an angle of which nothing is known
    J, f, w, turn, C = np.empty((5, 15)), np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    force = np.empty(3)
    at, every = 0, len(cov) == len(rows)
    speed, per_unrest, swing_s, share, drift, push = knobs[0], knobs[1], knobs[2], knobs[3], knobs[4], knobs[5]
    first_tilt, first_speed, flicker_s, unseen, lost_s = knobs[6], knobs[7], knobs[8], knobs[9], knobs[10]
    for m in range(len(counts)):
        s, own = states[which[m]], known[m]
        for i in range(5):
            for j in range(15):
                J[i, j] = s[BY + 15 * i + j]
        # ---- what was learnt since: past errors stay, and cease to move with the present parameters
        if not np.isnan(s[TIME]):
            passed = s[TIME] - s[SINCE]
            for j in range(15):
                new, old, walked = own[KNOWN_STD + j] ** 2, s[VAR + j], 0.0
                if j < 3:
                    new += own[KNOWN_FLICKER] ** 2
                    walked = (own[KNOWN_WALK] ** 2 + 2 * own[KNOWN_FLICKER] ** 2 / flicker_s) * passed
                if new != old:
                    if j < 3:
                        s[SINCE] = s[TIME]
                    then = max(old + walked, new)
                    kept = old / then if then > 0 else 1.0
                    for i in range(3):
                        left = J[i, j] ** 2 * (old * (1 - kept) + kept**2 * (then - new))
                        if i == 2:
                            s[HEADING] += left
                        else:
                            s[NOISE] += left / 2
                    for i in range(5):
                        J[i, j] *= kept
                    s[VAR + j] = new
        # ---- samples
        for row in range(at, at + counts[m]):
            time, clipped = rows[row, 0], rows[row, 7] > 0
            x, y, z = rows[row, 1] - own[9], rows[row, 2] - own[10], rows[row, 3] - own[11]
            for r in range(3):
                w[r] = own[3 * r] * x + own[3 * r + 1] * y + own[3 * r + 2] * z
                force[r] = own[KNOWN_ACCEL + 3 + r] * (rows[row, 4 + r] - own[KNOWN_ACCEL + r])
            a0, a1, a2 = force[0], force[1], force[2]
            aided = not np.isnan(a0 + a1 + a2)
            fresh, broken = np.isnan(s[TIME]), False
            if fresh:
                broken = True
                dt = 0.0
                for j in range(75):
                    J[j // 15, j % 15] = 0.0
                for j in range(VELOCITY, HEADING + 1):
                    s[j] = 0.0
                for j in range(15):
                    s[VAR + j] = own[KNOWN_STD + j] ** 2
                    if j < 3:
                        s[VAR + j] += own[KNOWN_FLICKER] ** 2
                s[SINCE], s[INTERVAL] = time, 0.0
                q0, q1, q2, q3 = 1.0, 0.0, 0.0, 0.0
                if aided:
                    norm = np.sqrt(a0 * a0 + a1 * a1 + a2 * a2)
                    if norm + a2 > 1e-6 * norm and norm > 0:
                        q0, q1, q2 = norm + a2, a1, -a0
                    elif norm > 0:
                        q0, q1 = 0.0, 1.0
                    s[GAIN] = s[NOISE] = first_tilt**2
                    s[GAIN + 2] = s[NOISE + 2] = first_speed**2
            else:
                dt = time - s[TIME] if time >= s[TIME] else lost_s  # the device's clock went back
                q0, q1, q2, q3 = s[1], s[2], s[3], s[4]
                added = 0.0
                pace = np.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
                if s[INTERVAL] == 0.0:
                    s[INTERVAL] = dt
                if dt > 1.5 * s[INTERVAL] + 1e-3:  # samples are missing: the rate between is a guess
                    broken = True
                    before = np.sqrt(s[RATE] ** 2 + s[RATE + 1] ** 2 + s[RATE + 2] ** 2)
                    for r in range(3):
                        turn[r] = (w[r] + s[RATE + r]) / 2 * dt if dt < lost_s else 0.0
                    guess = (unseen + (pace + before) / 4) if dt < lost_s else 1.0 + pace
                    added = (guess * dt) ** 2
                else:
                    for r in range(3):
                        turn[r] = w[r] * dt
                    s[INTERVAL] += 0.01 * (dt - s[INTERVAL])
                    if clipped:  # at the end of its range the true rate is not known; such samples come in runs
                        added = (pace / 2) ** 2 * dt * 0.05
                # q times the rotation in device axes
                angle = np.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
                sine = np.sin(angle / 2) / angle if angle > 1e-9 else 0.5
                c0, c1, c2, c3 = np.cos(angle / 2), sine * turn[0], sine * turn[1], sine * turn[2]
                q0, q1, q2, q3 = (
                    q0 * c0 - q1 * c1 - q2 * c2 - q3 * c3,
                    q0 * c1 + q1 * c0 + q2 * c3 - q3 * c2,
                    q0 * c2 - q1 * c3 + q2 * c0 + q3 * c1,
                    q0 * c3 + q1 * c2 - q2 * c1 + q3 * c0,
                )
                white = (own[KNOWN_NOISE] ** 2 + own[KNOWN_NOISE + 1] ** 2 + own[KNOWN_NOISE + 2] ** 2) / 3 * dt * dt
                s[HEADING] = min(s[HEADING] + white + added, limit)
                s[NOISE] = min(s[NOISE] + white + added, limit)
                s[GAIN] = min(s[GAIN] + (drift**2 + (share * pace) ** 2) * dt + added, 1.0)
                if broken:
                    s[VELOCITY] = s[VELOCITY + 1] = 0.0
                    s[GAIN + 1] = s[NOISE + 1] = 0.0
                    s[GAIN + 2] = s[NOISE + 2] = first_speed**2
                    for j in range(15):
                        J[3, j] = J[4, j] = 0.0
            norm = np.sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
            q0, q1, q2, q3 = q0 / norm, q1 / norm, q2 / norm, q3 / norm
            C[0, 0], C[0, 1], C[0, 2] = 1 - 2 * (q2 * q2 + q3 * q3), 2 * (q1 * q2 - q0 * q3), 2 * (q1 * q3 + q0 * q2)
            C[1, 0], C[1, 1], C[1, 2] = 2 * (q1 * q2 + q0 * q3), 1 - 2 * (q1 * q1 + q3 * q3), 2 * (q2 * q3 - q0 * q1)
            C[2, 0], C[2, 1], C[2, 2] = 2 * (q1 * q3 - q0 * q2), 2 * (q2 * q3 + q0 * q1), 1 - 2 * (q1 * q1 + q2 * q2)
            for i in range(3):
                for c in range(3):
                    J[i, c] += (C[i, 0] * own[c] + C[i, 1] * own[3 + c] + C[i, 2] * own[6 + c]) * dt
                    for r in range(3):
                        J[i, 3 + 3 * r + c] += C[i, r] * w[c] * dt
            if trace.shape[0] > 0:
                for j in range(TRACE):
                    trace[row, j] = 0.0
            if aided and not fresh and not broken:
                # A reading is the mean over its interval: the force is that in the middle, half a turn ago.
                b0 = a0 - (turn[1] * a2 - turn[2] * a1) / 2
                b1 = a1 - (turn[2] * a0 - turn[0] * a2) / 2
                b2 = a2 - (turn[0] * a1 - turn[1] * a0) / 2
                for i in range(3):
                    f[i] = C[i, 0] * b0 + C[i, 1] * b1 + C[i, 2] * b2
                # ---- prediction of velocity
                v0, v1 = s[VELOCITY] + f[0] * dt, s[VELOCITY + 1] + f[1] * dt
                fade = min(dt / swing_s, 1.0)
                s[SWING] += f[0] * dt - fade * s[SWING]
                s[SWING + 1] += f[1] * dt - fade * s[SWING + 1]
                s[UNREST] += fade * (s[SWING] ** 2 + s[SWING + 1] ** 2 - s[UNREST])
                a = g * dt
                for j in range(15):
                    J[3, j] += a * J[1, j]
                    J[4, j] -= a * J[0, j]
                for c in range(3):
                    J[3, 12 + c] -= C[0, c] * dt
                    J[4, 12 + c] -= C[1, c] * dt
                shaken = push**2 * dt
                p00, p01, p11 = s[GAIN], s[GAIN + 1], s[GAIN + 2]
                p11 += 2 * a * p01 + a * a * p00 + shaken
                p01 += a * p00
                n00, n01, n11 = s[NOISE], s[NOISE + 1], s[NOISE + 2]
                n11 += 2 * a * n01 + a * a * n00 + shaken
                n01 += a * n00
                # ---- the velocity is measured as zero, once a second's worth
                R = (speed**2 + per_unrest**2 * s[UNREST]) / max(dt, 1e-9)
                k0, k1 = p01 / (p11 + R), p11 / (p11 + R)
                phi0, phi1, dv0, dv1 = k0 * v1, -k0 * v0, -k1 * v0, -k1 * v1
                if trace.shape[0] > 0:
                    t = trace[row]
                    t[0], t[1], t[2] = p00, p01, p11
                    t[3], t[4], t[5] = p00 - k0 * p01, p01 - k0 * p11, p11 - k1 * p11
                    t[6], t[7], t[8], t[9], t[10] = phi0, phi1, dv0, dv1, dt
                s[GAIN], s[GAIN + 1], s[GAIN + 2] = p00 - k0 * p01, p01 - k0 * p11, p11 - k1 * p11
                s[NOISE] = n00 - 2 * k0 * n01 + k0 * k0 * (n11 + R)
                s[NOISE + 1] = n01 - k1 * n01 - k0 * n11 + k0 * k1 * (n11 + R)
                s[NOISE + 2] = n11 - 2 * k1 * n11 + k1 * k1 * (n11 + R)
                for j in range(15):
                    J[0, j] += k0 * J[4, j]
                    J[1, j] -= k0 * J[3, j]
                    J[3, j] -= k1 * J[3, j]
                    J[4, j] -= k1 * J[4, j]
                s[VELOCITY], s[VELOCITY + 1] = v0 + dv0, v1 + dv1
                # exp(phi) q, with phi small and horizontal
                angle = np.sqrt(phi0 * phi0 + phi1 * phi1)
                sine = np.sin(angle / 2) / angle if angle > 1e-9 else 0.5
                c0, c1, c2 = np.cos(angle / 2), sine * phi0, sine * phi1
                q0, q1, q2, q3 = (
                    c0 * q0 - c1 * q1 - c2 * q2,
                    c0 * q1 + c1 * q0 + c2 * q3,
                    c0 * q2 - c1 * q3 + c2 * q0,
                    c0 * q3 + c1 * q2 - c2 * q1,
                )
            if every or row == at + counts[m] - 1:
                of, place = row if every else m, 0
                for i in range(3):
                    for k in range(i, 3):
                        total = 0.0
                        for j in range(15):
                            total += J[i, j] * s[VAR + j] * J[k, j]
                        if i == k:
                            total = min(total + (s[HEADING] if i == 2 else s[NOISE]), limit)
                        s[COV + place] = cov[of, place] = total
                        place += 1
            s[TIME] = time
            s[1], s[2], s[3], s[4] = q0, q1, q2, q3
            s[RATE], s[RATE + 1], s[RATE + 2] = w[0], w[1], w[2]
            to = out[row]
            to[0], to[1], to[2], to[3] = q0, q1, q2, q3
            for i in range(3):
                to[RESULT_ACCEL + i] = C[i, 0] * a0 + C[i, 1] * a1 + C[i, 2] * a2
            to[RESULT_ACCEL + 2] -= g
        at += counts[m]
        for i in range(5):
            for j in range(15):
                s[BY + 15 * i + j] = J[i, j]


@compiled("void(f8[:, ::1], f8[:, ::1], f8[:])")
def smoothed(trace: Floats, quaternions: Floats, tilt_share: Floats) -> None:
    """Correct quaternions (n, 4) in place by later samples: a Rauch-Tung-Striebel pass over a trace (n, 11).

    trace (n, 11): written by `carried`, with these columns:

        0..2   before the update: variance of tilt (rad²), covariance of both (rad m/s), variance of velocity ((m/s)²)
        3..5   the same after the update
        6, 7   correction of the tilt about x and y, rad
        8, 9   correction of the velocity along x and y, m/s
        10     sample interval, s; 0 where nothing was corrected

    quaternions (n, 4): sensor to earth, w x y z.
    tilt_share (n,), written: variance of the smoothed tilt divided by that of the real-time tilt.
    """
    g, n = 9.80665, len(trace)
    phi0 = phi1 = v0 = v1 = 0.0
    s00 = s01 = s11 = 0.0
    linked = False
    for i in range(n - 1, -1, -1):
        tilt_share[i] = 1.0
        p00, p01, p11 = trace[i, 3], trace[i, 4], trace[i, 5]
        if trace[i, 10] == 0.0:
            linked = False
            continue
        if linked:
            t = trace[i + 1]
            a, det = g * t[10], t[0] * t[2] - t[1] * t[1]
            b00, b01, b10, b11 = p00, a * p00 + p01, p01, a * p01 + p11
            g00, g01 = (b00 * t[2] - b01 * t[1]) / det, (b01 * t[0] - b00 * t[1]) / det
            g10, g11 = (b10 * t[2] - b11 * t[1]) / det, (b11 * t[0] - b10 * t[1]) / det
            phi0, phi1, v0, v1 = phi0 + t[6], phi1 + t[7], v0 + t[8], v1 + t[9]
            # v_x goes with phi_y, v_y with -phi_x
            phi1, v0 = g00 * phi1 + g01 * v0, g10 * phi1 + g11 * v0
            phi0, v1 = g00 * phi0 - g01 * v1, -g10 * phi0 + g11 * v1
            d00, d01, d11 = s00 - t[0], s01 - t[1], s11 - t[2]
            e0, e1, e2, e3 = g00 * d00 + g01 * d01, g00 * d01 + g01 * d11, g10 * d00 + g11 * d01, g10 * d01 + g11 * d11
            s00, s01, s11 = p00 + e0 * g00 + e1 * g01, p01 + e0 * g10 + e1 * g11, p11 + e2 * g10 + e3 * g11
            tilt_share[i] = min(max(s00 / p00, 0.0), 1.0)
            angle = np.sqrt(phi0 * phi0 + phi1 * phi1)
            sine = np.sin(angle / 2) / angle if angle > 1e-9 else 0.5
            c0, c1, c2 = np.cos(angle / 2), sine * phi0, sine * phi1
            q0, q1, q2, q3 = quaternions[i]
            quaternions[i, 0] = c0 * q0 - c1 * q1 - c2 * q2
            quaternions[i, 1] = c0 * q1 + c1 * q0 + c2 * q3
            quaternions[i, 2] = c0 * q2 - c1 * q3 + c2 * q0
            quaternions[i, 3] = c0 * q3 + c1 * q2 - c2 * q1
        else:
            phi0 = phi1 = v0 = v1 = 0.0
            s00, s01, s11 = p00, p01, p11
            linked = True
