"""Equations of the closure calibration: maximum likelihood over bias and scale factors, for many sessions at once.

Letters, for s sessions, r rests, 3 turns of n samples:

    m, dt   reading (rad/s) and its sample interval (s)      b, k   bias (rad/s) and scale factors: g = k (m - b)
    C_t     attitude after sample t, C_0 = I                 R      C_n, the end of a turn, in the frame of its start
    D       end attitude, measured by gravity or assumed     Exp, log   between rotation vectors (rad) and rotations
    y_j     mean reading of rest j (rad/s)                   w      change of the bias since the reference time (rad/s)
    P_t     effect on R of a rate error in sample t (s)      K      diag(k)
    E       axis misalignment (3, 3), zero diagonal          '      transpose

Residuals:  f_j = y_j - b  of rest j, rad/s,    f_i = log(R_i D_i')  of turn i, rad, in the frame of the turn's start.

A change dg_t of the rates turns R by eps = sum_t P_t dg_t on the left, with P_t = C_(t-1) Jl(g_t dt) dt. Jl is the left
Jacobian of SO(3). The code uses (C_(t-1) + C_t)/2 dt, which differs from P_t by the relative amount (rate dt)²/12.
The derivatives of the residuals are

    A_i = sum P_t K,   df_i/db = -J A_i,   df_i/dk = J sum P_t diag(m_t - b),   J = Jl(f_i)^-1;   A_j = I, df_j/db = -I

At the true b and k the residuals are

    f_j = w_j + mean noise
    f_i = J (A_i w_i + sum P_t K (noise_t + E (m_t - b))) + errors of the hand or the accelerometer

E is the same in all turns. The fit neither estimates E nor includes it in the covariance S of f. A sample can belong to
both a rest and a turn; it then correlates the two residuals.

The solver is Gauss-Newton on L^-1 f, with the Cholesky factor L L' = S. The covariance of (b, k) is (F' S^-1 F)^-1,
with F = df/d(b, k). The dependence of S on k carries some 1e-6 of the information and is neglected.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.geometry import rotation

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Input of the closure fit: s sessions, each with r rests and 3 turns of n samples.

    Rates are in rad/s, times in s, angles in rad, variances and covariances in the squares of these. Shorter turns are
    padded with samples of dt = 0.
    reading (s, 3, n, 3), dt (s, 3, n): readings of the turns and their sample intervals.
    noise_var (s, 3): variance of the white noise of one reading.
    rest, rest_var, rest_common_var (s, r, 3): mean readings of the rests, their white-noise variance, and the variance
        of the error that all rests share.
    shared (s, 2, 3, r): seconds of each turn's first and second half that belong to each rest, over the sample count of
        that rest.
    walk (s, r + 3, r + 3): covariance, (rad/s)² per axis, of the bias change from the reference time to each rest and
        turn.
    end (s, 3, 3, 3), end_cov (s, 3, 3, 3): end attitudes, and their covariance in the frame of the start.
    coning: True to apply the coning correction.
    """

    #: (s, 3, n, 3) readings of the turns, and (s, 3, n) the seconds each holds
    reading: Floats
    dt: Floats
    #: (s, 3) variance of the white noise of one reading
    noise_var: Floats
    #: (s, r, 3) mean readings of the rests, their variance from white noise, and that of the error they all share
    rest: Floats
    rest_var: Floats
    rest_common_var: Floats
    #: (s, 2, 3, r) seconds of turn i, at its beginning and at its end, that belong to rest j, over j's sample count
    shared: Floats
    #: (s, r + 3, r + 3) covariance, (rad/s)², of the change w of each axis' bias at rests and turns
    walk: Floats
    #: (s, 3, 3, 3) end attitudes of the turns as measured or assumed, and their covariance in the frame of the start
    end: Floats
    end_cov: Floats
    #: whether to apply the coning correction, for long sample intervals
    coning: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Maximum-likelihood fit of s sessions: bias b (s, 3) rad/s, and scale factors k (s, 3) without unit.

    covariance (s, 6, 6): of b and k, in this order.
    gain (s, 6, 3r + 9): derivatives of b and k by each residual: of the r rests (rad/s), then of the 3 turns (rad).
    turn_b (s, 3, 3): most likely bias during each turn, rad/s.
    f (s, 3, 3): residuals of the turns, rad, computed with the bias `turn_b`.
    f_turn (s, 3, 3), f_cov (s, 3, 3, 3): residuals of the turns, rad, computed with the bias `b`, and their covariance,
        rad².
    rest_misfit (s,), chi2 (s,): chi-square of the rests, and of rests and turns together, computed with the bias `b`.
    converged (s,): True where the iteration converged.
    """

    b: Floats
    k: Floats
    covariance: Floats
    gain: Floats
    turn_b: Floats
    f: Floats
    f_turn: Floats
    f_cov: Floats
    rest_misfit: Floats
    chi2: Floats
    converged: NDArray[np.bool_]
    iterations: int


def fit(evidence: Evidence, max_iterations: int = 12, tolerance: float = 0.01) -> Fit:
    """Maximum-likelihood fit of bias and scale factors to the evidence of s sessions, by Gauss-Newton.

    tolerance: a session has converged when its last step is below this many standard deviations.
    A session that does not converge within `max_iterations` has False in `Fit.converged`. Raises LinAlgError for a
    singular problem.
    """
    theta = start(evidence)
    iterations, converged = 0, np.zeros(len(theta), bool)
    while iterations < max_iterations and np.isfinite(theta).all() and not converged.all():
        f, F, S, _ = linearise(evidence, theta)
        white = np.linalg.solve(np.linalg.cholesky(S), np.concatenate([F, f[..., None]], axis=-1))
        WF, Wf = white[..., :6], white[..., 6:]
        information = WF.swapaxes(-1, -2) @ WF
        step = -np.linalg.solve(information, WF.swapaxes(-1, -2) @ Wf)
        theta = theta + step[..., 0]
        converged = np.linalg.norm(WF @ step, axis=(-1, -2)) < tolerance
        iterations += 1
    return _found(evidence, theta, f + (F @ step)[..., 0], F, S, converged, iterations)


def _found(
    evidence: Evidence, theta: Floats, f: Floats, F: Floats, S: Floats, converged: NDArray[np.bool_], iterations: int
) -> Fit:
    s, r = evidence.rest.shape[:2]
    explained = np.linalg.solve(S, np.concatenate([F, f[..., None]], axis=-1))
    # Most likely change of the bias given the residuals: cov(w, f) S^-1 f.
    A = -F.reshape(s, r + 3, 3, 6)[..., :3]
    pull = A.swapaxes(-1, -2) @ explained[..., 6].reshape(s, r + 3, 3, 1)
    way = (evidence.walk @ pull[..., 0])[:, r:]
    f_turn = f.reshape(s, r + 3, 3)[:, r:]
    turns = np.arange(r, r + 3)
    f_cov = np.moveaxis(S.reshape(s, r + 3, 3, r + 3, 3)[:, turns, :, turns], 0, 1)
    f_rest, rest_cov = f[:, : 3 * r], S[:, : 3 * r, : 3 * r]
    covariance = np.linalg.inv(F.swapaxes(-1, -2) @ explained[..., :6])
    return Fit(
        b=theta[:, :3],
        k=theta[:, 3:],
        covariance=np.asarray(covariance),
        gain=np.asarray(-covariance @ explained[..., :6].swapaxes(-1, -2)),
        turn_b=theta[:, None, :3] + way,
        f=f_turn - (A[:, r:] @ way[..., None])[..., 0],
        f_turn=f_turn,
        f_cov=f_cov,
        rest_misfit=np.einsum("si,si->s", f_rest, np.linalg.solve(rest_cov, f_rest[..., None])[..., 0]),
        chi2=np.einsum("si,si->s", f, explained[..., 6]),
        converged=converged,
        iterations=iterations,
    )


def start(evidence: Evidence) -> Floats:
    """Start values (s, 6) of the fit: bias (3) rad/s, the weighted mean of the rests, then scale factors (3).

    The scale factors solve |integral of k (m - b)| = 360° for each turn, which is linear in k². This criterion is that
    of Wang et al. 2024 for turns about fixed axes. For turns by hand its error is about 1e-3.
    """
    weight = 1 / (evidence.rest_var + evidence.rest_common_var)
    b = (weight * evidence.rest).sum(axis=1) / weight.sum(axis=1)
    read = ((evidence.reading - b[:, None, None]) * evidence.dt[..., None]).sum(axis=2)
    square = np.full((*b.shape, 1), 4 * np.pi**2)
    try:
        k_square = np.linalg.solve(read**2, square)[..., 0]
    except np.linalg.LinAlgError:
        k_square = np.ones_like(b)
    return np.concatenate([b, np.sqrt(np.where(k_square > 0.01, k_square, 1.0))], axis=-1)


def linearise(evidence: Evidence, theta: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Linearise the residuals of s sessions at theta (s, 6): bias (3) rad/s, then scale factors (3).

    Returns four arrays; r rests come first, then 3 turns:

        f  (s, 3r + 9)           residuals: rests in rad/s, turns in rad
        F  (s, 3r + 9, 6)        derivatives of f by theta
        S  (s, 3r + 9, 3r + 9)   covariance of f
        (s, 9, 6)                derivatives of the turns' residuals, rad, by the axis misalignment, rad:
                                 the six off-diagonal elements of E, by rows
    """
    b, k = theta[:, :3], theta[:, 3:]
    s, r = evidence.rest.shape[:2]
    read = (evidence.reading - b[:, None, None]) * evidence.dt[..., None]
    steps = k[:, None, None] * read
    C = rotation.chained(rotation.coned(steps) if evidence.coning else steps)
    R = C[:, :, -1]
    f_turn = rotation.log(R @ evidence.end.swapaxes(-1, -2))
    J = left_jacobian_inverse(f_turn)

    A = np.empty((s, r + 3, 3, 3))
    A[:, :r] = np.eye(3)
    # One matrix product gives both sums: of P_t, and of column i of P_t times element j of the reading.
    columns = C.reshape(*C.shape[:3], 9).swapaxes(-1, -2)
    sums = columns @ _middles(np.concatenate([evidence.dt[..., None], read], axis=-1))
    A[:, r:] = J @ sums[..., 0].reshape(s, 3, 3, 3) * k[:, None, None]
    by_E = (J @ sums[..., 1:].reshape(s, 3, 3, 9)).reshape(s, 3, 3, 3, 3)
    F = np.zeros((s, r + 3, 3, 6))
    F[..., :3] = -A
    F[:, r:, :, 3:] = np.einsum("...aii->...ai", by_E)
    f = np.concatenate([evidence.rest - b[:, None], f_turn], axis=1)
    S = _covariance(evidence, k, C, J, A)
    # With M = K (I + E), an element E_ij adds k_i times the reading of axis j to the rate of axis i.
    across = (by_E * k[:, None, None, :, None])[..., ~np.eye(3, dtype=bool)].reshape(s, 9, 6)
    return f.reshape(s, -1), F.reshape(s, -1, 6), S, across


def _covariance(evidence: Evidence, k: Floats, C: Floats, J: Floats, A: Floats) -> Floats:
    """Covariance (s, 3r + 9, 3r + 9) of the residuals: bias walk, noise, error shared by rests, and uncertainty of the ends."""
    s, r = evidence.rest.shape[:2]
    rest = np.arange(r)
    rows = A.reshape(s, -1, 3)
    S = (rows @ rows.swapaxes(-1, -2)).reshape(s, r + 3, 3, r + 3, 3) * evidence.walk[:, :, None, :, None]
    common = np.sqrt(evidence.rest_common_var)
    for axis in range(3):
        S[:, :r, axis, :r, axis] += common[:, :, None, axis] * common[:, None, :, axis]
        S[:, rest, axis, rest, axis] += evidence.rest_var[..., axis]
    noise = J @ _noise(evidence, k, C) @ J.swapaxes(-1, -2) + evidence.end_cov
    for turn in range(3):
        S[:, r + turn, :, r + turn] += noise[:, turn]
    # Noise of samples in both a rest and a turn: sum of P_t K var / samples of the rest; C_t is I before and R after.
    ends = np.stack([np.broadcast_to(np.eye(3), J.shape), C[:, :, -1]], axis=1)
    once = J[:, None] @ ends * (k * evidence.noise_var)[:, None, None, None]
    both = np.einsum("szij,sziab->siajb", evidence.shared, once)
    S[:, r:, :, :r] += both
    S[:, :r, :, r:] += both.transpose(0, 3, 4, 1, 2)
    return S.reshape(s, 3 * r + 9, 3 * r + 9)


def _noise(evidence: Evidence, k: Floats, C: Floats) -> Floats:
    """Covariance (s, 3, 3, 3) from the white noise of the readings of each turn: sum of (C_t K dt) var (C_t K dt)'.

    Computed by one matrix product: the sums of dt² times each pair of elements of C_t.
    """
    elements = C[:, :, 1:].reshape(*evidence.dt.shape, 9)
    gram = elements.swapaxes(-1, -2) @ (elements * evidence.dt[..., None] ** 2)
    by_axis = gram.reshape(*C.shape[:2], 3, 3, 3, 3)
    return np.asarray(np.einsum("siajbj,sj->siab", by_axis, k**2 * evidence.noise_var))


def _middles(values: Floats) -> Floats:
    """Factors of C_0 … C_n where values (…, n, m) multiply (C_(t-1) + C_t)/2: means of neighbours, with 0 beyond the ends."""
    result = np.zeros((*values.shape[:-2], values.shape[-2] + 1, values.shape[-1]))
    result[..., 1:, :] = values
    result[..., :-1, :] += values
    return result / 2


def left_jacobian_inverse(vector: Floats) -> Floats:
    """Inverse left Jacobian (…, 3, 3) of SO(3) at rotation vectors v (…, 3), rad.

    J satisfies log(Exp(e) Exp(v)) = v + J e for small e. Requires |v| < 2 pi.
    """
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    half = np.maximum(angle, 1e-3) / 2
    second = np.where(angle < 1e-3, 1 / 12 + angle**2 / 720, (1 - half / np.tan(half)) / (4 * half**2))
    V = rotation.cross_matrix(vector)
    return np.asarray(np.eye(3) - V / 2 + second * (V @ V))
