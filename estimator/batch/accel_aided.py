"""The classical calibration by gravity in many poses, in two steps: the accelerometer first, then the gyro against it.

Source: D. Tedaldi, A. Pretto, E. Menegatti, "A robust and easy to implement method for IMU calibration without external
equipments", ICRA 2014, after Fong, Ong, Nee 2008. Letters:

    T, a0   upper triangular (6) and offset (3) of the accelerometer: |T (a - a0)| = G at every rest
    b       bias of the gyro: mean of the rests
    M       matrix of the gyro (9): u_after, integrated through M (m - b), must be u_before

Unlike `transitions` it believes in the second step that the first left no error, gives every movement the same weight, and
knows nothing of full turns. Its covariance is the classical one, from the residuals: it sees no error common to the poses.
"""

from collections.abc import Sequence
from math import degrees, radians

import numpy as np
from scipy.optimize import least_squares

from bridge.wire.messages import Verdict
from bridge.wording import count
from estimator import rotation
from estimator.batch.capture import Capture, Floats, Movement, Rest
from estimator.batch.carry import COLUMN, MATRIX_PARAMETERS, ROW, collect
from estimator.batch.gravity import G
from estimator.batch.path import integrate
from estimator.batch.result import Result, VerdictKnobs, nothing, turn_report, unbelievable
from estimator.gyro import reading_std

#: poses for nine unknowns of the accelerometer, one equation each
FEWEST_POSES = 9


def by_accel_aided(capture: Capture) -> Result:
    """The method: bias and full matrix from at least nine poses and the movements between them."""
    movements = capture.movements
    data = collect(movements)
    accel = np.array([rest.accel for rest in data.rests])
    differ = _that_differ(accel)
    if differ < FEWEST_POSES:
        reason = f"{count(differ, 'different pose')}; {FEWEST_POSES} are needed for the accelerometer's own errors"
        return nothing("accel_aided", Verdict.REPEAT, reason, (0, 1, 2))
    u = gravity_of(accel)
    b, b_cov = _bias(data.rests)
    steps = [(samples, u[i], u[j]) for samples, (i, j) in zip(data.samples, data.links, strict=True)]
    noise_std = np.median([reading_std(rest.std) for rest in data.rests], axis=0)

    def residuals(x: Floats) -> tuple[Floats, Floats, Floats]:
        r, J, by_b = [], [], []
        M = _matrix(x)
        for samples, before, after in steps:
            path = integrate(samples, M, b, noise_std)
            arrived = path.end @ after
            turned = -np.cross(arrived, np.eye(3)).T  # d(arrived) = phi x arrived
            r.append(arrived - before)
            J.append(turned @ path.by_matrix[:, ROW, COLUMN])
            by_b.append(turned @ path.by_bias)
        return np.concatenate(r), np.vstack(J), np.vstack(by_b)

    start = np.array([1.0, 1, 1, 0, 0, 0, 0, 0, 0])
    found = least_squares(lambda x: residuals(x)[0], start, jac=lambda x: residuals(x)[1], method="lm")
    r, J, by_b = residuals(found.x)
    # Three residuals a movement, of which gravity determines two.
    variance = float(r @ r) / max(2 * len(steps) - 9, 1)
    information = J.T @ J
    if np.linalg.cond(information) > 1e8:
        reason = "the poses do not determine the matrix: rest it on all its sides, turning between about every axis"
        return nothing("accel_aided", Verdict.REPEAT, reason, (0, 1, 2))
    by_bias = -np.linalg.solve(information, J.T @ by_b)
    covariance = np.zeros((12, 12))
    covariance[:3, :3] = b_cov
    covariance[3:, :3] = by_bias @ b_cov
    covariance[:3, 3:] = covariance[3:, :3].T
    covariance[3:, 3:] = variance * np.linalg.inv(information) + by_bias @ b_cov @ by_bias.T
    return _judge(capture, movements, _matrix(found.x), b, covariance, r)


def gravity_of(accel: Floats) -> Floats:
    """(n, 3) unit directions of gravity from mean readings (n, 3) in many poses, the accelerometer calibrated on them."""

    def corrected(x: Floats) -> Floats:
        T = np.diag(x[:3])
        T[[0, 0, 1], [1, 2, 2]] = x[3:6]
        return (accel - x[6:]) @ T.T

    start = np.array([1.0, 1, 1, 0, 0, 0, 0, 0, 0])
    fit = least_squares(lambda x: np.linalg.norm(corrected(x), axis=1) - G, start, method="lm")
    g = corrected(fit.x)
    return np.asarray(g / np.linalg.norm(g, axis=1)[:, None])


def _that_differ(accel: Floats) -> int:
    """How many of the readings (n, 3) are 20 degrees or more from all that are counted before them."""
    counted: list[Floats] = []
    for a in accel:
        if all(rotation.angle_between(a, b) > radians(20) for b in counted):
            counted.append(a)
    return len(counted)


def _matrix(x: Floats) -> Floats:
    M = np.empty((3, 3))
    M[ROW, COLUMN] = x
    return M


def _bias(rests: Sequence[Rest]) -> tuple[Floats, Floats]:
    reading = np.array([rest.bias for rest in rests])
    # Their scatter, noise and wander together, is all that is known of the mean.
    return reading.mean(axis=0), np.diag(reading.var(axis=0, ddof=1) / len(reading))


def _judge(
    capture: Capture, movements: Sequence[Movement], M: Floats, b: Floats, covariance: Floats, r: Floats
) -> Result:
    limits = VerdictKnobs()
    missed = degrees(float(np.sqrt(np.mean(np.sum(r.reshape(-1, 3) ** 2, axis=1)))))
    reason = f"full matrix: gravity carried through {count(len(movements), 'movement')} to {missed:.2f}° rms"
    verdict = Verdict.ACCEPTED
    repeat: tuple[int, ...] = ()
    bad = unbelievable(np.diag(M), limits)
    std = np.sqrt(np.diag(covariance)[3:])
    if bad is not None:
        verdict, repeat, reason = Verdict.REFUSED, *bad
    elif std.max() > limits.scale_std:
        verdict, repeat = Verdict.REPEAT, (0, 1, 2)
        reason = (
            f"the movements leave the matrix uncertain by {100 * std.max():.1f} %: more poses that differ are needed"
        )
    rests = [m.before for m in movements]
    noise_std = np.median([reading_std(rest.std) for rest in rests], axis=0)
    turns = tuple(turn_report(turn, M, b) for turn in capture.turns)
    time = float(np.mean([rest.middle for rest in rests]))
    return Result("accel_aided", verdict, reason, M, b, covariance, noise_std, turns, repeat, time, MATRIX_PARAMETERS)
