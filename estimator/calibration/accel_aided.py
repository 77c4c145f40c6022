"""Two-step gyro calibration by gravity in many poses: the accelerometer first, then the gyro matrix against it.

Source: D. Tedaldi, A. Pretto, E. Menegatti, "A robust and easy to implement method for IMU calibration without external
equipments", ICRA 2014, after Fong, Ong, Nee 2008. Letters:

    T, a0   accelerometer: upper triangular matrix (6 elements, no unit) and offset (3,), m/s²
    G       9.80665 m/s²; |T (a - a0)| = G for the mean reading a, m/s², at every rest
    u       unit direction of gravity at a rest, in sensor axes: T (a - a0) normalised
    m, b    gyro reading and bias of each movement, (3,) rad/s
    M       gyro matrix (3, 3), no unit: u_after, integrated through M (m - b), must be u_before

Both steps are least squares by Levenberg-Marquardt. The second step assumes an accelerometer without error, and weighs
all movements equally. It does not use that a full turn ends in its start heading. The method `transitions` differs in
all three points.

Two additions to the source:

- Where the rests show that the bias moved, each movement has the bias of the rests around it.
- The covariance propagates errors of readings, paths and biases through both steps to M. `transitions` estimates the
    sizes of these errors.
"""

from collections.abc import Sequence
from math import degrees, radians

import numpy as np
import scipy

from bridge.reasons.codes import Code
from bridge.wire.messages import Verdict
from estimator.calibration import accelerometer_errors
from estimator.calibration.accelerometer_errors import G
from estimator.calibration.capture import Capture, Floats, Movement
from estimator.calibration.gravity_propagation import (
    COLUMN,
    MATRIX_PARAMETERS,
    ROW,
    Problem,
    TransitionKnobs,
    collect,
    matrix_of,
)
from estimator.calibration.result import SCALE_STD, Result, concluded, nothing, turn_report
from estimator.calibration.turn_path import Path, integrate
from estimator.geometry import rotation
from estimator.geometry.gyro_model import reading_std

#: least number of poses: nine accelerometer unknowns, one equation per pose
FEWEST_POSES = 9
#: indices of the elements above a matrix's diagonal
_UPPER = ([0, 0, 1], [1, 2, 2])


def by_accel_aided(capture: Capture) -> Result:
    """Calibration method `accel_aided`: bias (3,) rad/s and full matrix (3, 3) from nine or more poses, with verdict.

    capture: the estimate uses all its movements, of any angle; they need accelerometer readings. Angle and closure
        error of its full turns are only reported.
    Verdict REPEAT without an estimate: fewer than nine distinct poses, or poses that do not determine the matrix.
    Verdict REPEAT with an estimate: the standard deviation of a matrix element is above 0.02 (no unit).
    Verdict REFUSED: a scale factor is outside 0.7 to 1.4.
    """
    movements = capture.movements
    data = collect(movements)
    accel = np.array([rest.accel for rest in data.rests])
    differ = _that_differ(accel)
    if differ < FEWEST_POSES:
        few = Code.TOO_FEW_POSES(poses=differ, least=FEWEST_POSES)
        return nothing("accel_aided", Verdict.REPEAT, (few,), (0, 1, 2))
    x, u = _accelerometer(accel)
    problem = Problem(data, TransitionKnobs())
    off = problem.biases
    b = off.mean + off.local
    steps = [(samples, u[i], u[j], b_m) for samples, (i, j), b_m in zip(data.samples, data.links, b, strict=True)]
    noise_std = np.median([reading_std(rest.std) for rest in data.rests], axis=0)

    def residuals(x: Floats) -> tuple[Floats, Floats]:
        r, J = [], []
        for samples, before, after, b_m in steps:
            path = integrate(samples, matrix_of(x), b_m, noise_std)
            arrived = path.end @ after
            r.append(arrived - before)
            J.append(_turned(arrived) @ path.by_matrix[:, ROW, COLUMN])
        return np.concatenate(r), np.vstack(J)

    start = np.array([1.0, 1, 1, 0, 0, 0, 0, 0, 0])
    found = scipy.optimize.least_squares(lambda x: residuals(x)[0], start, jac=lambda x: residuals(x)[1], method="lm")
    r, J = residuals(found.x)
    if np.linalg.cond(J.T @ J) > 1e8:
        return nothing("accel_aided", Verdict.REPEAT, (Code.POSES_UNDETERMINED(),), (0, 1, 2))
    M = matrix_of(found.x)
    paths = [integrate(samples, M, b_m, noise_std) for samples, _, _, b_m in steps]
    factors = problem.factors(problem.solve(np.concatenate([off.mean, found.x, np.zeros(accelerometer_errors.N)])))
    gain = np.linalg.solve(J.T @ J, J.T)
    by_accel = gain @ _by_poses(data.links, paths, u) @ _by_accel(accel, x)
    by_path = gain @ scipy.linalg.block_diag(
        *(_turned(p.end @ u[b]) for p, (_, b) in zip(paths, data.links, strict=True))
    )
    of_path = scipy.linalg.block_diag(*(problem.path_cov(path, factors) for path in paths))
    by_rests = np.vstack([_by_rests(p.by_bias, w) for p, w in zip(paths, off.by_reading[:-1], strict=True)])
    # Slopes of bias and M by the gyro readings at rest.
    of_rests = np.vstack([_by_rests(np.eye(3), off.by_reading[-1]), -by_path @ by_rests])
    covariance = (of_rests * off.noise.ravel()) @ of_rests.T
    covariance[:3, :3] += np.diag(off.mean_moved)
    covariance[3:, 3:] += (by_accel * problem.accel_var(factors).ravel()) @ by_accel.T + by_path @ of_path @ by_path.T
    return _judge(capture, movements, M, off.mean, covariance, r)


def _by_rests(by_bias: Floats, weight: Floats) -> Floats:
    """Slopes (3, 3n) by n readings whose mean with weights (n, 3) is the bias; by_bias (3, 3): slopes by the bias."""
    return np.asarray(np.einsum("ik,nk->ink", by_bias, weight).reshape(3, -1))


def _turned(arrived: Floats) -> Floats:
    """Slope (3, 3) of a direction by a small rotation phi: phi x arrived."""
    return np.asarray(-np.cross(arrived, np.eye(3)).T)


def _by_poses(links: Sequence[tuple[int, int]], paths: Sequence[Path], u: Floats) -> Floats:
    """Slopes (3m, 3n) of the residuals of m movements by the unit directions u (n, 3)."""
    by_u = np.zeros((len(links), 3, *u.shape))
    for k, ((a, b), path) in enumerate(zip(links, paths, strict=True)):
        by_u[k, :, a], by_u[k, :, b] = -np.eye(3), path.end
    return by_u.reshape(3 * len(links), -1)


def _accelerometer(accel: Floats) -> tuple[Floats, Floats]:
    """Fit T and a0 (9,) to readings (n, 3); also the unit directions (n, 3) of the corrected readings."""
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


def _by_accel(accel: Floats, x: Floats) -> Floats:
    """Slopes (3n, 3n) of all unit directions by the readings (n, 3), directly and through T and a0."""
    T, g, n = _upper(x), _corrected(accel, x), len(accel)
    size = np.linalg.norm(g, axis=1)
    u = g / size[:, None]
    by_x = np.zeros((n, 3, 9))  # slopes of each g
    by_x[:, [0, 1, 2], [0, 1, 2]] = accel - x[6:]
    by_x[:, _UPPER[0], [3, 4, 5]] = (accel - x[6:])[:, _UPPER[1]]
    by_x[:, :, 6:] = -T
    strength = np.einsum("ni,nik->nk", u, by_x)  # slopes of |g| by T and a0
    moved = -np.linalg.pinv(strength)[:, :, None] * (u @ T)[None]  # slopes of T and a0 by each reading
    g_by_accel = np.einsum("nik,kmj->nimj", by_x, moved)
    g_by_accel[np.arange(n), :, np.arange(n)] += T
    across = (np.eye(3) - u[:, :, None] * u[:, None]) / size[:, None, None]
    return np.asarray(np.einsum("nki,nimj->nkmj", across, g_by_accel).reshape(3 * n, 3 * n))


def _that_differ(accel: Floats) -> int:
    """Number of distinct poses: readings (n, 3) more than 20 degrees from all that are counted before them."""
    counted: list[Floats] = []
    for a in accel:
        if all(rotation.angle_between(a, b) > radians(20) for b in counted):
            counted.append(a)
    return len(counted)


def _judge(
    capture: Capture, movements: Sequence[Movement], M: Floats, b: Floats, covariance: Floats, r: Floats
) -> Result:
    missed = degrees(float(np.sqrt(np.mean(np.sum(r.reshape(-1, 3) ** 2, axis=1)))))
    carried = Code.GRAVITY_CARRIED(movements=len(movements), angle_deg=f"{missed:.2f}")
    std = np.sqrt(np.diag(covariance)[3:]).max()
    unsure = Verdict.REPEAT, (0, 1, 2), (Code.MATRIX_UNCERTAIN(percent=f"{100 * std:.1f}"),)
    verdict, repeat, reason = concluded(np.diag(M), (Code.FULL_MATRIX(), carried), unsure if std > SCALE_STD else None)
    rests = [m.before for m in movements]
    noise_std = np.median([reading_std(rest.std) for rest in rests], axis=0)
    turns = tuple(turn_report(turn, M, b) for turn in capture.turns)
    time = float(np.mean([rest.middle for rest in rests]))
    return Result("accel_aided", verdict, reason, M, b, covariance, noise_std, turns, repeat, time, MATRIX_PARAMETERS)
