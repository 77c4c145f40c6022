"""The default calibration: the bias and scale under which every turn ends where it began, as sure as the data make them.

All rests measure the bias, each turn's end closes on SO(3) whatever path the hand took, and what may differ from that is
named with its size: noise, a bias that moves, rounding, and how well a hand puts a device back. With an accelerometer
the tilt after a turn is measured instead of assumed. The equations are in closure_fit.
"""

from dataclasses import dataclass, replace
from math import radians

import numpy as np
import scipy
from numpy.typing import NDArray

from estimator import rotation
from estimator.batch.capture import Capture, Rest, TurnCapture
from estimator.batch.closure_fit import Evidence, Fit, fit
from estimator.gyro import reading_std

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ClosureKnobs:
    """What may keep a turn from closing, and a bias from staying. Standard deviations."""

    #: rad per axis between a turn's start and end against a table's edge, where no accelerometer saw them
    replacement_std: float = radians(0.2)
    #: rad about the vertical, which an accelerometer does not see: a quarter of a millimetre over an edge of 5 cm
    heading_std: float = radians(0.3)
    #: rad of tilt that an accelerometer errs by in two rests in the same pose, beside its noise
    tilt_floor: float = radians(0.1)
    #: relative error of an accelerometer (scale, misalignment, bias over g): so much of a tilt that it sees
    tilt_share: float = 0.02
    #: of each element that takes the gyro's axes to orthogonal ones: not estimated here, and felt where a turn tilts
    misalignment_std: float = 0.01
    #: rad/s per root second that a bias moves, as in tracking
    rate_random_walk: float = radians(2e-3)
    #: output rates, Hz, below which a rate's change of direction within a sample is made good
    coning_below_hz: float = 50.0
    #: where residuals are less probable than this, the hand, or the bias, is taken to be as bad as they show
    honest_p: float = 0.01


class NotConverged(Exception):
    """No bias and scale close the three turns."""


@dataclass(frozen=True, slots=True, eq=False)
class Closure:
    """k (3,) and bias (3,) rad/s at device time `time`; their covariance (6, 6) in the order bias, k.

    turn_bias (3, 3): the bias during each turn, where a bias that moves was likeliest then.
    residual (3, 3) rad: by what each turn does not close, in the frame it started in, beyond a tilt that was measured.
    misfit (3,): how unlikely that is under the knobs, as chi-square of 3 degrees of freedom. chi2, dof: of all residuals.
    """

    k: Floats
    bias: Floats
    covariance: Floats
    time: float
    turn_bias: Floats
    residual: Floats
    misfit: Floats
    chi2: float
    dof: int
    iterations: int


def estimate(capture: Capture, knobs: ClosureKnobs | None = None) -> Closure:
    """The calibration of one session; raises NotConverged."""
    knobs = knobs or ClosureKnobs()
    rests = capture.rests or (capture.rest,)
    told = evidence(capture, knobs)
    try:
        first = found = fit(told)
        if first.converged[0]:
            shown = _as_shown(told, first, knobs)
            found = first if shown is told else fit(shown)
    except np.linalg.LinAlgError:
        raise NotConverged(
            "the turns do not determine the three scale factors: one about each axis is needed"
        ) from None
    if not found.converged[0] or np.any(found.k[0] > 100):
        raise NotConverged(
            f"no scale factors close the three turns (after {found.iterations} steps k = {np.round(found.k[0], 3)})"
        )
    return Closure(
        k=found.k[0],
        bias=found.b[0],
        covariance=found.covariance[0],
        time=rests[-1].middle,
        turn_bias=found.turn_b[0],
        residual=found.f[0],
        misfit=first.misfit[0],
        chi2=float(first.chi2[0]),
        dof=3 * len(rests) + 3,
        iterations=found.iterations,
    )


def _as_shown(told: Evidence, found: Fit, knobs: ClosureKnobs) -> Evidence:
    """The evidence with errors of turns, or of rests, as large as their residuals; unchanged where these are as told."""
    # A turn's residual along its axis went into k, and one rest's into the bias.
    turn_dof, rest_dof = 6, 3 * told.rest.shape[1] - 3
    turns, rests = float(found.misfit[0].sum()), float(found.rest_misfit[0])
    shown = told
    if turns > scipy.special.chdtri(turn_dof, knobs.honest_p):
        shown = replace(shown, end_cov=told.end_cov + (turns / turn_dof - 1) * found.f_cov)
    if rest_dof and rests > scipy.special.chdtri(rest_dof, knobs.honest_p):
        larger = rests / rest_dof
        shown = replace(shown, rest_var=larger * told.rest_var, walk=larger * told.walk)
    return shown


def evidence(capture: Capture, knobs: ClosureKnobs) -> Evidence:
    """One session's captures as the stacked arrays of the fit; the bias is that of the middle of the last rest."""
    rests, turns = capture.rests or (capture.rest,), capture.turns
    n = max(len(turn.samples) for turn in turns)
    reading, dt = np.zeros((3, n, 3)), np.zeros((3, n))
    for i, turn in enumerate(turns):
        reading[i, : len(turn.samples)] = turn.samples.gyro
        dt[i, : len(turn.samples)] = rotation.intervals(turn.samples.time)
    counts = np.array([rest.n for rest in rests])
    std = np.array([reading_std(rest.std) for rest in rests])
    ends = [_end(turn, knobs) for turn in turns]
    return Evidence(
        reading=reading[None],
        dt=dt[None],
        noise_var=(counts @ std**2 / counts.sum())[None],
        rest=np.array([[rest.bias for rest in rests]]),
        rest_var=(std**2 / counts[:, None] + np.array([rest.wander for rest in rests]) ** 2)[None],
        rest_common_var=np.array([[rest.rounding_var for rest in rests]]),
        shared=np.array([[[_shared(turn, dt[i], rests, late) for i, turn in enumerate(turns)] for late in (0, 1)]]),
        walk=knobs.rate_random_walk**2 * _walk(rests, turns)[None],
        end=np.array([[end for end, _ in ends]]),
        end_cov=np.array([[cov for _, cov in ends]]),
        misalignment_var=knobs.misalignment_std**2,
        coning=1 / float(np.median(np.diff(turns[0].samples.time))) < knobs.coning_below_hz,
    )


def _end(turn: TurnCapture, knobs: ClosureKnobs) -> tuple[Floats, Floats]:
    """(3, 3) the end of a turn in the frame of its start, and the covariance (3, 3) of its error.

    Gravity tells the end's tilt; about gravity the turn is taken to have closed.
    """
    before, after = turn.before, turn.after
    if before.accel is None or after.accel is None:
        return np.eye(3), knobs.replacement_std**2 * np.eye(3)
    up, then = (a / np.linalg.norm(a) for a in (before.accel, after.accel))
    V = rotation.cross_matrix(np.cross(then, up))
    end = np.eye(3) + V + V @ V / (1 + up @ then)
    noise_var = _direction_var(before) + _direction_var(after)
    tilt_var = knobs.tilt_floor**2 + (knobs.tilt_share * rotation.angle_between(up, then)) ** 2 + noise_var
    return end, tilt_var * np.eye(3) + (knobs.heading_std**2 - tilt_var) * np.outer(up, up)


def _direction_var(rest: Rest) -> float:
    """rad² per axis of the direction of a rest's mean acceleration, from its white noise."""
    if rest.accel is None or rest.accel_std is None:
        return 0.0
    return float(np.mean(rest.accel_std**2)) / rest.n / float(rest.accel @ rest.accel)


def _shared(turn: TurnCapture, dt: Floats, rests: tuple[Rest, ...], late: int) -> list[float]:
    """For each rest, the seconds of its samples in the beginning (late 0) or end (1) of the turn, over all its samples."""
    time = turn.samples.time
    halfway = len(time) // 2
    spans = [np.searchsorted(time, (rest.start, rest.end + 1e-9)) for rest in rests]
    return [
        float(dt[max(a, late * halfway) : (b if late else min(b, halfway))].sum()) / rest.n
        for rest, (a, b) in zip(rests, spans, strict=True)
    ]


def _walk(rests: tuple[Rest, ...], turns: tuple[TurnCapture, ...]) -> Floats:
    """(r + 3, r + 3) s: covariance of a unit random walk's means over rests and turns, from the middle of the last rest.

    It is half of E|a - ref| + E|b - ref| - E|a - b|, for times a and b within the two; within one, E|a - b| is a third
    of its length, and a quarter to its middle.
    """
    spans = [(rest.start, rest.end) for rest in rests] + [(turn.before.end, turn.after.start) for turn in turns]
    middle, length = np.array([((a + b) / 2, b - a) for a, b in spans]).T
    apart = np.abs(middle[:, None] - middle)
    np.fill_diagonal(apart, length / 3)
    last = len(rests) - 1
    away = np.abs(middle - middle[last])
    away[last] = length[last] / 4
    return np.asarray((away[:, None] + away - apart) / 2)
