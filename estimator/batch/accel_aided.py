"""The classical calibration by gravity in many poses, in two steps: the accelerometer first, then the gyro against it.

Source: D. Tedaldi, A. Pretto, E. Menegatti, "A robust and easy to implement method for IMU calibration without external
equipments", ICRA 2014, after Fong, Ong, Nee 2008. Letters:

    T, a0   upper triangular (6) and offset (3) of the accelerometer: |T (a - a0)| = G at every rest
    b       bias of the gyro: mean of the rests
    M       matrix of the gyro (9): u_after, integrated through M (m - b), must be u_before

Unlike `transitions` it solves the second step as if the first had left no error, gives every movement the same weight, and
knows nothing of full turns. Its covariance is not the classical one, of the second step's residuals as if each had an error of
its own: all that either step leaves over is taken for an error of the accelerometer's readings a, one a pose, and goes from
there through both into M. A pose is of two movements, and what it does to T and a0 is of all.
"""

from collections.abc import Sequence
from math import degrees, radians

import numpy as np
import scipy

from bridge.wire.messages import Verdict
from bridge.wording import count
from estimator import rotation
from estimator.batch.capture import Capture, Floats, Movement, Rest
from estimator.batch.carry import COLUMN, MATRIX_PARAMETERS, ROW, collect
from estimator.batch.gravity import G
from estimator.batch.path import Path, integrate
from estimator.batch.result import Result, VerdictKnobs, nothing, turn_report, unbelievable
from estimator.gyro import reading_std

#: poses for nine unknowns of the accelerometer, one equation each
FEWEST_POSES = 9
#: of a matrix, above its diagonal
_UPPER = ([0, 0, 1], [1, 2, 2])


def by_accel_aided(capture: Capture) -> Result:
    """The method: bias and full matrix from at least nine poses and the movements between them."""
    movements = capture.movements
    data = collect(movements)
    accel = np.array([rest.accel for rest in data.rests])
    differ = _that_differ(accel)
    if differ < FEWEST_POSES:
        reason = f"{count(differ, 'different pose')}; {FEWEST_POSES} are needed for the accelerometer's own errors"
        return nothing("accel_aided", Verdict.REPEAT, reason, (0, 1, 2))
    x, u = _accelerometer(accel)
    b, b_cov = _bias(data.rests)
    steps = [(samples, u[i], u[j]) for samples, (i, j) in zip(data.samples, data.links, strict=True)]
    noise_std = np.median([reading_std(rest.std) for rest in data.rests], axis=0)

    def residuals(x: Floats) -> tuple[Floats, Floats]:
        r, J = [], []
        for samples, before, after in steps:
            path = integrate(samples, _matrix(x), b, noise_std)
            arrived = path.end @ after
            r.append(arrived - before)
            J.append(_turned(arrived) @ path.by_matrix[:, ROW, COLUMN])
        return np.concatenate(r), np.vstack(J)

    start = np.array([1.0, 1, 1, 0, 0, 0, 0, 0, 0])
    found = scipy.optimize.least_squares(lambda x: residuals(x)[0], start, jac=lambda x: residuals(x)[1], method="lm")
    r, J = residuals(found.x)
    if np.linalg.cond(J.T @ J) > 1e8:
        reason = "the poses do not determine the matrix: rest it on all its sides, turning between about every axis"
        return nothing("accel_aided", Verdict.REPEAT, reason, (0, 1, 2))
    M = _matrix(found.x)
    paths = [integrate(samples, M, b, noise_std) for samples in data.samples]
    gain = np.linalg.solve(J.T @ J, J.T)
    by_bias = -gain @ np.vstack(
        [_turned(p.end @ u[j]) @ p.by_bias for p, (_, j) in zip(paths, data.links, strict=True)]
    )
    covariance = np.zeros((12, 12))
    covariance[:3, :3] = b_cov
    covariance[3:, :3] = by_bias @ b_cov
    covariance[:3, 3:] = covariance[3:, :3].T
    covariance[3:, 3:] = _of_poses(_errors(accel, x), data.links, paths, u, r, J) + by_bias @ b_cov @ by_bias.T
    return _judge(capture, movements, M, b, covariance, r)


def _turned(arrived: Floats) -> Floats:
    """(3, 3) what a small rotation phi does to a direction: phi x arrived."""
    return np.asarray(-np.cross(arrived, np.eye(3)).T)


def _of_poses(
    errors: tuple[Floats, float, int],
    links: Sequence[tuple[int, int]],
    paths: Sequence[Path],
    u: Floats,
    r: Floats,
    J: Floats,
) -> Floats:
    """(9, 9) covariance of M by what both steps leave over, as errors of the poses' readings, and by the gyro's noise."""
    u_by_accel, left, freedom = errors
    by_u, noise = np.zeros((len(links), 3, *u.shape)), []
    for k, ((i, j), path) in enumerate(zip(links, paths, strict=True)):
        by_u[k, :, i], by_u[k, :, j] = -np.eye(3), path.end
        turned = _turned(path.end @ u[j])
        noise.append(turned @ path.noise @ turned.T)
    by_accel = by_u.reshape(len(r), -1) @ u_by_accel
    gain = np.linalg.solve(J.T @ J, J.T)
    taken = gain @ by_accel
    variance = (float(r @ r) + left) / (float(np.sum((by_accel - J @ taken) ** 2)) + freedom)
    # Three residuals a movement, of which gravity determines two; few leave the variance itself unsure, as Student's has it.
    freedom = max(3, freedom + 2 * len(links) - 9)
    return np.asarray(
        variance * freedom / (freedom - 2) * taken @ taken.T + gain @ scipy.linalg.block_diag(*noise) @ gain.T
    )


def gravity_of(accel: Floats) -> Floats:
    """(n, 3) unit directions of gravity from mean readings (n, 3) in many poses, the accelerometer calibrated on them."""
    return _accelerometer(accel)[1]


def _accelerometer(accel: Floats) -> tuple[Floats, Floats]:
    """T and a0 (9,) and the unit directions (n, 3) they make of the readings they were found from."""
    start = np.array([1.0, 1, 1, 0, 0, 0, 0, 0, 0])
    fit = scipy.optimize.least_squares(lambda x: np.linalg.norm(_corrected(accel, x), axis=1) - G, start, method="lm")
    g = _corrected(accel, fit.x)
    return np.asarray(fit.x), np.asarray(g / np.linalg.norm(g, axis=1)[:, None])


def _upper(x: Floats) -> Floats:
    T = np.diag(x[:3])
    T[_UPPER] = x[3:6]
    return T


def _corrected(accel: Floats, x: Floats) -> Floats:
    return np.asarray((accel - x[6:]) @ _upper(x).T)


def _errors(accel: Floats, x: Floats) -> tuple[Floats, float, int]:
    """What errors of the readings do to all unit directions, (3n, 3n); the sum of squares the fit left over, its freedom."""
    T, g, n = _upper(x), _corrected(accel, x), len(accel)
    size = np.linalg.norm(g, axis=1)
    u = g / size[:, None]
    by_x = np.zeros((n, 3, 9))  # of each g
    by_x[:, [0, 1, 2], [0, 1, 2]] = accel - x[6:]
    by_x[:, _UPPER[0], [3, 4, 5]] = (accel - x[6:])[:, _UPPER[1]]
    by_x[:, :, 6:] = -T
    strength = np.einsum("ni,nik->nk", u, by_x)  # of |g|, by T and a0
    moved = -np.linalg.pinv(strength)[:, :, None] * (u @ T)[None]  # T and a0, by each reading
    g_by_accel = np.einsum("nik,kmj->nimj", by_x, moved)
    g_by_accel[np.arange(n), :, np.arange(n)] += T
    across = (np.eye(3) - u[:, :, None] * u[:, None]) / size[:, None, None]
    by_accel = np.einsum("nki,nimj->nkmj", across, g_by_accel).reshape(3 * n, 3 * n)
    return by_accel, float(np.sum((size - G) ** 2)), n - 9


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
