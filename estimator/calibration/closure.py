"""Default calibration method: the bias and scale factors under which every turn ends in its start attitude.

All rests measure the bias. Whatever path the hand took, the integrated rotation of each turn must lead back to the
start attitude. An accelerometer, where present, measures how far the end of a turn is tilted from its start.
The error model has noise, a moving bias, rounding, the hand's error in putting the device back, and axis misalignment.
The sizes of the last two are estimated from the session: see replacement_error and misalignment.
The equations are in closure_fit.
"""

from dataclasses import dataclass, replace
from math import radians

import numpy as np
import scipy

from bridge.reasons.codes import Code
from estimator.calibration import misalignment
from estimator.calibration import replacement_error as replacement
from estimator.calibration.capture import Capture, Rest, TurnCapture
from estimator.calibration.closure_fit import Evidence, Fit, fit, linearise
from estimator.calibration.replacement_error import End, Replacement
from estimator.calibration.result import NotConverged
from estimator.geometry import rotation
from estimator.geometry.gyro_model import Floats, reading_std


@dataclass(frozen=True, slots=True)
class ClosureKnobs:
    """Settings of the closure method: assumed standard deviations of errors, and limits.

    replacement: attitude error of a hand that puts the device back, rad per axis. misalignment_std: of each
        off-diagonal element of the gyro matrix, rad. For both, None means estimated from the session.
    tilt_share: error of a tilt measured by the accelerometer, as a fraction of the tilt.
    rate_random_walk: of the bias, rad/s/√s.
    coning_below_hz: sample rate in Hz below which the coning correction is applied.
    honest_p: significance level of a chi-square test of the rests. If the chi-square is less probable than this, the
        variances of the rests and of the bias walk are enlarged.
    """

    #: rad per axis, between the start and the end of a turn by hand, and of a tilt measured by gravity
    replacement: Replacement | None = None
    #: of each off-diagonal element of the gyro's matrix; the elements themselves are not estimated
    misalignment_std: float | None = None
    #: error of a measured tilt, relative to the tilt (accelerometer scale, misalignment, bias over g)
    tilt_share: float = 0.02
    #: rate random walk of the bias, rad/s/√s, as in tracking
    rate_random_walk: float = radians(2e-3)
    #: output data rate, Hz, below which the coning correction is applied
    coning_below_hz: float = 50.0
    #: probability below which the scatter of the rests is taken for a faster-moving bias
    honest_p: float = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Closure:
    """Estimate of the closure method: scale factors k (3,) and bias (3,) rad/s at device time `time`, s.

    covariance (6, 6): in the order bias (rad/s), k (no unit).
    turn_bias (3, 3): most likely bias during each turn, rad/s, one row per turn.
    residual (3, 3): closure error of each turn, rad, as a rotation vector in the frame of the turn's start. A tilt
        measured by the accelerometer is subtracted.
    replacement, misalignment_std: the error sizes used, in rad, estimated or from the settings (ClosureKnobs).
    chi2, dof: chi-square of all residuals, and its degrees of freedom.
    """

    k: Floats
    bias: Floats
    covariance: Floats
    time: float
    turn_bias: Floats
    residual: Floats
    replacement: Replacement
    misalignment_std: float
    chi2: float
    dof: int


def estimate(capture: Capture, knobs: ClosureKnobs | None = None) -> Closure:
    """Estimate bias (rad/s) and scale factors from one session's rests and its three turns, by maximum likelihood.

    knobs: assumed error sizes; a size that is None is estimated from the session.
    Raises NotConverged when the fit does not converge, or when a scale factor is above 100.
    """
    knobs = knobs or ClosureKnobs()
    rests = capture.rests or (capture.rest,)
    ends = tuple(_end(turn, knobs.tilt_share) for turn in capture.turns)
    told = evidence(capture, knobs, ends, knobs.replacement or replacement.USUAL)
    try:
        found = fit(told)
    except np.linalg.LinAlgError:
        raise NotConverged(Code.TURNS_UNDETERMINED()) from None
    if not found.converged[0] or np.any(found.k[0] > 100):
        raise NotConverged(Code.NOT_CONVERGED(steps=found.iterations, scale=np.round(found.k[0], 3)))
    placed = knobs.replacement or replacement.estimate(ends, found.f_turn[0], found.f_cov[0] - told.end_cov[0])
    askew = knobs.misalignment_std
    if askew is None:
        askew = misalignment.estimate(told.reading[0] - found.b[0], told.dt[0], found.k[0], capture.turns)
    end_cov = np.array([[end.covariance(placed) for end in ends]])
    shown = replace(_with_scatter(told, found, knobs.honest_p), end_cov=end_cov)
    return Closure(
        k=found.k[0],
        bias=found.b[0],
        covariance=_covariance(shown, found, askew),
        time=rests[-1].middle,
        turn_bias=found.turn_b[0],
        residual=found.f[0],
        replacement=placed,
        misalignment_std=askew,
        chi2=float(found.chi2[0]),
        dof=3 * len(rests) + 3,
    )


def _covariance(shown: Evidence, found: Fit, misalignment_std: float) -> Floats:
    """Covariance (6, 6) of bias and k for the error sizes that the session showed, with the weights that the fit used."""
    _, _, S, by_E = linearise(shown, np.concatenate([found.b, found.k], axis=-1))
    gain = found.gain[0]
    across = gain[:, -by_E.shape[1] :] @ by_E[0]
    return np.asarray(gain @ S[0] @ gain.T + misalignment_std**2 * across @ across.T)


def _with_scatter(told: Evidence, found: Fit, honest_p: float) -> Evidence:
    """The evidence with the rests' variance and the bias walk enlarged where the rests scatter too much."""
    dof = 3 * told.rest.shape[1] - 3  # one rest went into the bias
    scatter = float(found.rest_misfit[0])
    if not dof or scatter <= scipy.special.chdtri(dof, honest_p):
        return told
    larger = scatter / dof
    return replace(told, rest_var=larger * told.rest_var, walk=larger * told.walk)


def evidence(capture: Capture, knobs: ClosureKnobs, ends: tuple[End, ...], placed: Replacement) -> Evidence:
    """Stack the rests and three turns of one session into the input arrays of the fit (Evidence for s = 1 session).

    knobs: assumed error sizes. placed: assumed error of the hand in putting the device back, rad.
    ends: measured or assumed end attitude of each turn.
    The fitted bias is the bias at the middle of the last rest.
    """
    rests, turns = capture.rests or (capture.rest,), capture.turns
    n = max(len(turn.samples) for turn in turns)
    reading, dt = np.zeros((3, n, 3)), np.zeros((3, n))
    for i, turn in enumerate(turns):
        reading[i, : len(turn.samples)] = turn.samples.gyro
        dt[i, : len(turn.samples)] = rotation.intervals(turn.samples.time)
    counts = np.array([rest.n for rest in rests])
    std = np.array([reading_std(rest.std) for rest in rests])
    return Evidence(
        reading=reading[None],
        dt=dt[None],
        noise_var=(counts @ std**2 / counts.sum())[None],
        rest=np.array([[rest.bias for rest in rests]]),
        rest_var=(std**2 / counts[:, None] + np.array([rest.wander for rest in rests]) ** 2)[None],
        rest_common_var=np.array([[rest.rounding_var for rest in rests]]),
        shared=np.array([[[_shared(turn, dt[i], rests, late) for i, turn in enumerate(turns)] for late in (0, 1)]]),
        walk=knobs.rate_random_walk**2 * _walk(rests, turns)[None],
        end=np.array([[end.attitude for end in ends]]),
        end_cov=np.array([[end.covariance(placed) for end in ends]]),
        coning=1 / float(np.median(np.diff(turns[0].samples.time))) < knobs.coning_below_hz,
    )


def _end(turn: TurnCapture, tilt_share: float) -> End:
    """End attitude of a turn: gravity measures its tilt; about gravity the turn is assumed to have closed."""
    before, after = turn.before, turn.after
    if before.accel is None or after.accel is None:
        return End(np.eye(3))
    up, then = (a / np.linalg.norm(a) for a in (before.accel, after.accel))
    across = np.cross(then, up)
    V = rotation.cross_matrix(across)
    tilt_var = (tilt_share * rotation.angle_between(up, then)) ** 2 + _direction_var(before) + _direction_var(after)
    return End(np.eye(3) + V + V @ V / (1 + up @ then), up, across, tilt_var)


def _direction_var(rest: Rest) -> float:
    """Variance, rad² per axis, of the direction of a rest's mean acceleration, from its white noise."""
    if rest.accel is None or rest.accel_std is None:
        return 0.0
    return float(np.mean(rest.accel_std**2)) / rest.n / float(rest.accel @ rest.accel)


def _shared(turn: TurnCapture, dt: Floats, rests: tuple[Rest, ...], late: int) -> list[float]:
    """For each rest: seconds of its samples in the first (late 0) or second (late 1) half of the turn, over its sample count."""
    time = turn.samples.time
    halfway = len(time) // 2
    spans = [np.searchsorted(time, (rest.start, rest.end + 1e-9)) for rest in rests]
    return [
        float(dt[max(a, late * halfway) : (b if late else min(b, halfway))].sum()) / rest.n
        for rest, (a, b) in zip(rests, spans, strict=True)
    ]


def _walk(rests: tuple[Rest, ...], turns: tuple[TurnCapture, ...]) -> Floats:
    """Covariance (r + 3, r + 3), s, of the means of a unit random walk over rests and turns, from the middle of the last rest.

    It is half of E|a - ref| + E|b - ref| - E|a - b|, for times a and b within the two stretches. Within one stretch,
    E|a - b| is a third of its length, and the mean distance to its middle is a quarter.
    """
    spans = [(rest.start, rest.end) for rest in rests] + [(turn.before.end, turn.after.start) for turn in turns]
    middle, length = np.array([((a + b) / 2, b - a) for a, b in spans]).T
    apart = np.abs(middle[:, None] - middle)
    np.fill_diagonal(apart, length / 3)
    last = len(rests) - 1
    away = np.abs(middle - middle[last])
    away[last] = length[last] / 4
    return np.asarray((away[:, None] + away - apart) / 2)
