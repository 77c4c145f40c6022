"""Calibration by Algorithm 1 of Wang et al. 2024: three 360-degree turns by hand, and an iterative attitude estimate.

Source: L. Wang, R. Duffield, D. Fox, A. Hammond, A. J. Zhang, W. X. Zheng, S. W. Su, "In-field gyroscope
autocalibration with iterative attitude estimation", Mechatronics 102 (2024) 103232 (arXiv 2103.11097), Algorithm 1.

The paper's letters and equation numbers:

    m       reading of the gyro (3,), rad/s                   T       duration of a turn, s
    K       diag(k), scale factors k (3,), no unit            C_t     attitude at sample t, from the turn's start
    b       -mean(m at rest), rad/s: minus the bias           dt      sample interval, s

    (1)     g = K (m + b)                                     the calibrated rate, rad/s
    (2)     b = -mean(m) at rest, so that g = 0
    (4)     R_t = R(g_t dt)                                   Rodrigues' formula
    (5)     C_t = C_(t-1) R_t, C_0 = I                        the product of all R so far
    (6-10)  G = mean over t of C_t g_t = A k                  A = mean over t of C_t diag(m_t + b)
    (11)    | A_i k | = 360 degrees / T_i                     for the three turns i

Algorithm 1 starts at K = I and repeats three steps:

    integrate (5) with K;   solve (11) for k with these attitudes;   stop if |k new - k| <= 1e-5

The criterion (11) holds for a turn about a fixed axis. When the hand wobbles by 3 degrees, the scale factors have an
error of about 1e-3. This file keeps the paper's method unchanged.
"""

from dataclasses import dataclass
from math import pi, radians

import numpy as np
import scipy

from bridge.reasons.codes import Code
from estimator.calibration.capture import Capture, TurnCapture
from estimator.calibration.result import NotConverged
from estimator.geometry import rotation
from estimator.geometry.gyro_model import Floats, reading_std

#: change of the scale factors, absolute, at which the iteration is done; and most iterations
_TOLERANCE, _MAX_ITERATIONS = 1e-5, 50
#: standard deviation, rad, of the end attitude of a turn by hand against its start, about the turn's axis
_REPLACEMENT_STD = radians(0.2)


@dataclass(frozen=True, slots=True, eq=False)
class Turn360:
    """Estimate of Algorithm 1: scale factors k (3,), bias (3,) rad/s, their covariance, and the number of iterations.

    covariance (6, 6): in the order bias (rad/s), k (no unit).
    """

    k: Floats
    bias: Floats
    covariance: Floats
    iterations: int


def estimate(capture: Capture) -> Turn360:
    """Estimate bias (rad/s) and scale factors by Algorithm 1 of Wang et al. 2024 from one rest and three turns.

    Raises NotConverged if the scale factors do not settle in 50 iterations, or leave the range 0 to 100.
    """
    b = -capture.rest.bias
    K = np.ones(3)
    for iteration in range(1, _MAX_ITERATIONS + 1):
        S = [turn_integral(turn, K, b) for turn in capture.turns]
        dK = solve_criteria(S)
        moved, K = np.linalg.norm(K * dK - K), K * dK
        if not np.all(np.isfinite(K)) or np.any(K <= 0) or np.any(K > 100):
            break
        if moved <= _TOLERANCE:
            return Turn360(K, -b, covariance(capture, K, b), iteration)
    raise NotConverged(Code.NOT_CONVERGED(steps=iteration, scale=np.round(K, 3)))


def turn_integral(turn: TurnCapture, K: Floats, b: Floats) -> Floats:
    """Integral S (3, 3), rad, of C_t diag(g_t) dt over one turn, with attitude C_t and rate g_t = K (m_t + b), rad/s.

    In the letters of equations (6-10), S = T A diag(K). If all rates are multiplied by factors dK (3,), the turn has
    the angle |S dK|, for fixed attitudes.
    K (3,): scale factors. b (3,): the paper's b, minus the bias, rad/s.
    """
    dt = rotation.intervals(turn.samples.time)
    g = K * (turn.samples.gyro + b)
    C = rotation.attitudes(g, dt)[1:]
    S: Floats = np.einsum("tij,tj,t->ij", C, g, dt)
    return S


def solve_criteria(S: list[Floats]) -> Floats:
    """Solve equation (11): factors dK (3,) = k new / k with |S_i dK| = 360 degrees for the three turns.

    S: one matrix (3, 3) per turn, rad, result of `turn_integral`. Method: Levenberg-Marquardt.
    """
    start = np.array([2 * pi / np.linalg.norm(S_i.sum(axis=1)) for S_i in S])
    axes = [int(np.argmax(np.abs(S_i.sum(axis=1)))) for S_i in S]
    guess = np.ones(3)
    if sorted(axes) == [0, 1, 2]:
        guess[axes] = start

    def excess(dK: Floats) -> Floats:
        return np.array([np.linalg.norm(S_i @ dK) - 2 * pi for S_i in S])

    def slope(dK: Floats) -> Floats:
        return np.array([S_i.T @ (S_i @ dK) / np.linalg.norm(S_i @ dK) for S_i in S])

    x: Floats = scipy.optimize.least_squares(
        excess, guess, jac=slope, method="lm", xtol=1e-12, ftol=1e-12, gtol=1e-12
    ).x
    return x


def covariance(capture: Capture, K: Floats, b: Floats) -> Floats:
    """First-order covariance (6, 6) of bias (rad/s) and scale factors, in this order, for Algorithm 1.

    K (3,): scale factors. b (3,): the paper's b, minus the bias, rad/s.
    Included errors: noise of the rest and of each turn, and re-placement by the hand.
    The paper gives no covariance. The method linearises each criterion, angle_i(k, bias, noise) = 360 degrees. The
    criterion is blind to the hand's wobble, so the closure error of a turn counts as an error of its angle.
    """
    by_k, by_bias, noise_var = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    for i, turn in enumerate(capture.turns):
        dt = rotation.intervals(turn.samples.time)
        g = K * (turn.samples.gyro + b)
        path = rotation.attitudes(g, dt)
        C, closure = path[1:], np.linalg.norm(rotation.log(path[-1]))
        S = np.einsum("tij,tj,t->ij", C, g, dt)
        u = S.sum(axis=1) / np.linalg.norm(S.sum(axis=1))
        along = np.einsum("i,tij->tj", u, C) * K * dt[:, None]
        by_k[i] = u @ S / K
        by_bias[i] = -along.sum(axis=0)
        noise_var[i] = np.sum((along * reading_std(capture.rest.std)) ** 2) + _REPLACEMENT_STD**2 + closure**2
    J = np.linalg.inv(by_k)
    bias_cov = capture.rest.bias_cov
    k_from_bias = -J @ by_bias
    result = np.zeros((6, 6))
    result[:3, :3] = bias_cov
    result[3:, :3] = k_from_bias @ bias_cov
    result[:3, 3:] = result[3:, :3].T
    result[3:, 3:] = J @ np.diag(noise_var) @ J.T + k_from_bias @ bias_cov @ k_from_bias.T
    return result
