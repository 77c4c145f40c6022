"""The closure calibration once more: plain loops, SciPy's rotations, slopes by differences, SciPy's least squares."""

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from estimator.calibration.capture import Capture, Floats


def slow_closure(capture: Capture, replacement_std: float) -> tuple[Floats, Floats]:
    """(6,) bias and k, and their covariance, of a capture that no accelerometer saw, at a constant bias.

    No sample may be in a rest and in a turn: then all errors are independent.
    """
    counts = np.array([rest.n for rest in capture.rests])
    std = np.sqrt(counts @ np.array([rest.std**2 for rest in capture.rests]) / counts.sum())

    def end(theta: Floats, i: int) -> tuple[Rotation, Floats]:
        time, gyro = capture.turns[i].samples.time, capture.turns[i].samples.gyro
        attitude, noise = Rotation.identity(), np.zeros((3, 3))
        for t in range(len(time)):
            dt = time[t] - time[t - 1] if t else np.median(np.diff(time))
            attitude = attitude * Rotation.from_rotvec(theta[3:] * (gyro[t] - theta[:3]) * dt)
            spread = attitude.as_matrix() @ np.diag(theta[3:] * std * dt)
            noise += spread @ spread.T
        return attitude, noise

    def errors(theta: Floats, roots: list[Floats]) -> Floats:
        rests = [(rest.bias - theta[:3]) / (rest.std / np.sqrt(rest.n)) for rest in capture.rests]
        closed = [np.linalg.solve(root, end(theta, i)[0].as_rotvec()) for i, root in enumerate(roots)]
        return np.concatenate([*rests, *closed])

    theta = np.concatenate([capture.rest.bias, [1.0, 1.0, 1.0]])
    for _ in range(2):  # the noise of a turn depends on k: weigh with the k of the round before
        ends = [end(theta, i)[1] + replacement_std**2 * np.eye(3) for i in range(3)]
        roots = [np.linalg.cholesky(cov) for cov in ends]
        found = least_squares(errors, theta, args=(roots,), x_scale=[1e-4] * 3 + [1e-3] * 3, xtol=1e-12, ftol=1e-12)
        theta = found.x
    covariance: Floats = np.linalg.inv(found.jac.T @ found.jac)
    return theta, covariance
