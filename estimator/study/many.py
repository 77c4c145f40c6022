"""Algorithm 1 and closure for many simulated sessions at once: arrays of sessions in, arrays of estimates out."""

import numpy as np

from bridge.sim.paper_sessions import PaperSessions
from estimator.calibration.closure_fit import Evidence, Floats, fit, linearise
from estimator.geometry import rotation


def evidence(sessions: PaperSessions, replacement_std: float, *, coning: bool = False) -> Evidence:
    """Build the input of the closure fit from simulated sessions, with known rests and turns and a constant bias.

    replacement_std: standard deviation of the hand's error in putting the device back, rad per axis.
    coning: True to correct for changes of the rotation axis within a sample, as `closure` does at low sample rates.
    """
    s, r, m, _ = sessions.rests.shape
    rest_noise = sessions.rests.var(axis=2, ddof=1)
    return Evidence(
        reading=sessions.turns,
        dt=sessions.dt,
        noise_var=rest_noise.mean(axis=1),
        rest=sessions.rests.mean(axis=2),
        rest_var=rest_noise / m,
        rest_common_var=np.zeros((s, r, 3)),
        shared=np.zeros((s, 2, 3, r)),
        walk=np.zeros((s, r + 3, r + 3)),
        end=np.broadcast_to(np.eye(3), (s, 3, 3, 3)),
        end_cov=np.broadcast_to(replacement_std**2 * np.eye(3), (s, 3, 3, 3)),
        coning=coning,
    )


def closure(seen: Evidence) -> tuple[Floats, Floats]:
    """Calibrate s sessions by closure (maximum likelihood): theta (s, 6), and its covariance (s, 6, 6).

    theta: bias (3) in rad/s, then scale factors k (3).
    Raises ArithmeticError when a session does not converge.
    """
    found = fit(seen)
    if not found.converged.all():
        raise ArithmeticError(f"{np.sum(~found.converged)} of {len(found.b)} sessions did not converge")
    return np.concatenate([found.b, found.k], axis=1), found.covariance


def bound(sessions: PaperSessions, noise_std: float, replacement_std: float) -> Floats:
    """Cramér-Rao bound (s, 6) for s sessions, as variances: bias (3) in (rad/s)², then scale factors (3).

    noise_std: standard deviation of one reading, rad/s. replacement_std: as in `evidence`, rad.
    The bound is the diagonal of the inverse information at the true parameters, from noise-free readings.
    """
    gyro, clean = sessions.gyro, sessions.rates / sessions.gyro.k + sessions.gyro.bias
    still = np.broadcast_to(gyro.bias, sessions.rests.shape)
    known = evidence(PaperSessions(gyro, still, clean, sessions.rates, sessions.dt), replacement_std)
    s, r, m, _ = still.shape
    var = np.full((s, 3), noise_std**2)
    known = Evidence(
        known.reading, known.dt, var, known.rest, np.full((s, r, 3), noise_std**2 / m), known.rest_common_var,
        known.shared, known.walk, known.end, known.end_cov,
    )  # fmt: skip
    _, F, S, _ = linearise(known, np.tile(np.concatenate([gyro.bias, gyro.k]), (s, 1)))
    information = F.swapaxes(-1, -2) @ np.linalg.solve(S, F)
    return np.asarray(np.diagonal(np.linalg.inv(information), axis1=1, axis2=2))


def algorithm1(sessions: PaperSessions, tolerance: float = 1e-5, max_iterations: int = 50) -> Floats:
    """Calibrate s sessions by Algorithm 1 of Wang et al. 2024, as turn360.estimate does: theta (s, 6).

    theta: bias (3) in rad/s, the mean of the first rest, then scale factors k (3).
    tolerance: relative change of the scale factors at which a session is done.
    """
    bias = sessions.rests[:, 0].mean(axis=1)
    K = np.ones_like(bias)
    open_ = np.arange(len(K))
    read = (sessions.turns - bias[:, None, None]) * sessions.dt[..., None]
    for _ in range(max_iterations):
        step = K[open_, None, None] * read[open_]
        C = rotation.chained(step)[..., 1:, :, :]
        elements = C.reshape(*step.shape[:-1], 9).swapaxes(-1, -2)
        S = np.einsum("...ijj->...ij", (elements @ step).reshape(*step.shape[:2], 3, 3, 3))
        dK = _criteria(S)
        K[open_] *= dK
        open_ = open_[np.linalg.norm(dK - 1, axis=1) > tolerance]
        if not len(open_):
            break
    return np.concatenate([bias, K], axis=1)


def _criteria(S: Floats) -> Floats:
    """(s, 3) factors dK with |S_i dK| = 360° in each of the three turns, by Newton steps."""
    dK = 2 * np.pi / np.linalg.norm(S.sum(axis=-1), axis=-1)
    for _ in range(20):
        v = np.einsum("sij,sj->si", S.reshape(-1, 3, 3), np.repeat(dK, 3, axis=0)).reshape(*dK.shape, 3)
        excess = np.square(v).sum(axis=-1) - 4 * np.pi**2
        slope = 2 * (v[..., None, :] @ S)[..., 0, :]
        change = np.linalg.solve(slope, excess[..., None])[..., 0]
        dK = dK - change
        if np.abs(change).max() < 1e-13:
            break
    return np.asarray(dK)
