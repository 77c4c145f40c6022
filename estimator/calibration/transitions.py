"""Calibration of the full 3x3 gyro matrix from gravity before and after every movement, where the poses allow it.

Full turns alone determine only the diagonal: the second half of a turn cancels a misalignment's effect in the first.
Movements between different poses determine the misalignment. The accuracy depends on the poses and is part of the
covariance.
Where one off-diagonal element stays too uncertain, all of them are set to zero. The standard deviation of the diagonal
then includes the unknown elements.
"""

from dataclasses import dataclass, replace
from math import degrees

import numpy as np

from bridge.reasons.codes import Code, Sentence, Sentences
from bridge.wire.messages import Verdict
from estimator.calibration.axis_alignment import foreign_axes
from estimator.calibration.capture import Capture, Floats, Samples
from estimator.calibration.gravity_propagation import (
    ACROSS,
    MATRIX_PARAMETERS,
    Problem,
    TransitionKnobs,
    Transitions,
    collect,
    matrix_of,
)
from estimator.calibration.result import PARAMETERS, SCALE_STD, Result, nothing, turn_report, unbelievable
from estimator.geometry import rotation
from estimator.geometry.gyro_model import axis_names, reading_std

#: least number of movements for nine elements, two equations per movement
FEWEST = 6
#: chi-square over degrees of freedom beyond which movements contradict each other
MISFIT = 4.0
#: lower limit of the variance of unit weight: few movements may agree by chance
LEAST_UNIT = 1e-4
#: largest condition number of the data's information on the matrix: above, the prior determines elements, not the poses
CONDITION = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Fit of bias, matrix and accelerometer errors: theta (21,), in the order of gravity_propagation.PARAMETERS.

    Units of theta: bias rad/s, matrix no unit, accelerometer bias m/s², scale and shear relative (rad).
    covariance (21, 21): of theta, with error sizes estimated from the residuals.
    misfit: chi-square of the gravity and heading residuals over degrees of freedom, with the assumed error sizes.
    condition: condition number of the whitened residuals' derivatives by the matrix elements, after removing the effect
        of all other parameters.
    angles (m,): angle between propagated and measured gravity of each movement, rad.
    ratio (m,): the same in standard deviations.
    full: True if the off-diagonal elements are used.
    left_out: number of movements left out because they contradict the others.
    unknown: name and standard deviation (rad) of off-diagonal elements that the poses did not determine, worst first.
    """

    theta: Floats
    covariance: Floats
    misfit: float
    condition: float
    angles: Floats
    ratio: Floats
    full: bool = True
    left_out: int = 0
    unknown: tuple[tuple[str, float], ...] = ()

    @property
    def matrix(self) -> Floats:
        """Gyro matrix M (3, 3), no unit: rate = M (reading - bias). Its off-diagonal elements are 0 unless the fit is `full`."""
        M = matrix_of(self.theta[3:12])
        return M if self.full else np.diag(np.diag(M))


def fit(data: Transitions, knobs: TransitionKnobs | None = None) -> Fit:
    """Fit bias (rad/s), 3x3 gyro matrix and accelerometer errors to all movements by weighted least squares.

    data: rests and movements. knobs: assumed error sizes and priors.
    Raises LinAlgError when the movements do not determine the parameters.
    """
    knobs = knobs or TransitionKnobs()
    problem = Problem(data, knobs)
    theta = problem.prior_mean.copy()
    short = [j for j, samples in enumerate(data.samples) if _way(samples, theta[:3]) < knobs.short]
    if 0 < len(short) < len(data.links):
        # An error of a whole turn looks like no error: find the scale from short movements first.
        few = data.only(short)
        theta[3:6] = Problem(few, knobs).solve(theta)[3:6]
    theta = problem.solve(theta)
    r, J, _ = problem.whitened(theta)
    rows = problem.rows
    leverage = np.einsum("ij,ji->i", J, np.linalg.pinv(J))
    misfit = float(r[:rows] @ r[:rows]) / max(rows - float(leverage[:rows].sum()), 1.0)
    condition = _condition(J[:rows])
    _, ratio = problem.misses(theta)
    # Residuals smaller than assumed give the movements more weight against the priors.
    problem.unit = max(misfit, LEAST_UNIT)
    theta = problem.solve(theta)
    angles, _ = problem.misses(theta)
    return Fit(theta, problem.spread(theta, problem.factors(theta)), misfit, condition, angles, ratio)


def _way(samples: Samples, bias: Floats) -> float:
    return float(np.linalg.norm(samples.gyro - bias, axis=1) @ rotation.intervals(samples.time))


def _condition(J: Floats) -> float:
    """Condition number of the information of rows J on M, with bias and accelerometer eliminated."""
    M, others = J[:, 3:12], np.delete(J, np.s_[3:12], axis=1)
    return float(np.linalg.cond(M - others @ np.linalg.lstsq(others, M, rcond=None)[0]))


def estimate(data: Transitions, knobs: TransitionKnobs | None = None) -> Fit:
    """Fit the full matrix if the movements determine every element well enough, else the diagonal (`Fit.full` is False).

    Movements that contradict the others are left out, at most one in five.
    Raises LinAlgError when the movements do not determine the parameters.
    """
    knobs = knobs or TransitionKnobs()
    found, kept = fit(data, knobs), list(range(len(data.links)))
    while found.misfit > MISFIT and len(kept) > max(FEWEST, 0.8 * len(data.links)):
        del kept[int(np.argmax(found.ratio))]
        found = fit(data.only(kept), knobs)
    std = np.sqrt(np.diag(found.covariance)[6:12])
    unknown = tuple((ACROSS[i], float(std[i])) for i in np.argsort(-std) if std[i] > knobs.element_std)
    full = len(kept) >= FEWEST and not unknown and found.condition < CONDITION
    return replace(found, full=full, left_out=len(data.links) - len(kept), unknown=unknown)


def by_transitions(capture: Capture) -> Result:
    """Calibration method `transitions`: bias (3,) rad/s and full matrix (3, 3), or its diagonal, from all movements.

    Verdict REFUSED, without an estimate, when the movements do not determine the parameters. Other verdicts: see
    `judge_fit`.
    """
    data = collect(capture.movements)
    try:
        found = estimate(data)
    except np.linalg.LinAlgError:
        return nothing("transitions", Verdict.REFUSED, (Code.MOVEMENTS_UNDETERMINED(),))
    return judge_fit(capture, data, found)


def judge_fit(capture: Capture, data: Transitions, found: Fit) -> Result:
    """Give a verdict with a reason on a fit to the movements of a capture, as a calibration result.

    data: the rests and movements that were fitted.
    The result reports the capture's turns, but does not judge them.
    Verdict REPEAT: a scale factor has a relative standard deviation of 2 % or more. REFUSED: wrong axes, a scale factor
    outside 0.7 to 1.4, or `found.misfit` above 4.
    """
    matrix, bias, parameters = found.matrix, found.theta[:3], MATRIX_PARAMETERS if found.full else PARAMETERS
    covariance = found.covariance[: len(parameters), : len(parameters)]
    k, std = np.diag(matrix), np.sqrt(np.diag(covariance)[3:6])
    loose = tuple(axis for axis in range(3) if not std[axis] < SCALE_STD * k[axis])
    missed = degrees(float(np.sqrt(np.mean(found.angles**2))))
    carried = Code.GRAVITY_CARRIED(movements=len(found.angles), angle_deg=f"{missed:.2f}")
    reason: Sentences
    repeat: tuple[int, ...] = ()
    outside = unbelievable(k)
    if (outside or found.misfit > MISFIT) and (
        foreign := foreign_axes([(m.before, m.samples) for m in capture.movements], np.eye(3))
    ):
        verdict, reason = Verdict.REFUSED, (foreign,)
    elif loose:
        verdict, repeat = Verdict.REPEAT, loose
        reason = (Code.MOVEMENTS_UNCERTAIN(axes=axis_names(loose)),)
    elif outside is not None:
        verdict, repeat, reason = Verdict.REFUSED, *outside
    elif found.misfit > MISFIT:
        verdict = Verdict.REFUSED
        reason = (carried, Code.MOVEMENTS_MISFIT(times=f"{found.misfit**0.5:.1f}"))
    elif found.full:
        verdict = Verdict.ACCEPTED
        out = (Code.MOVEMENTS_LEFT_OUT(movements=found.left_out),) if found.left_out else ()
        reason = (Code.FULL_MATRIX(), Code.CONDITION_NUMBER(number=f"{found.condition:.0f}"), carried, *out)
    else:
        verdict, reason = Verdict.ACCEPTED, (Code.DIAGONAL_ONLY(), _why(found), carried)
    rests = data.rests
    noise_std = np.median([reading_std(rest.std) for rest in rests], axis=0)
    turns = tuple(turn_report(turn, matrix, bias) for turn in capture.turns)
    time = float(np.mean([rest.middle for rest in rests]))
    return Result("transitions", verdict, reason, matrix, bias, covariance, noise_std, turns, repeat, time, parameters)


def _why(found: Fit) -> Sentence:
    if len(found.angles) < FEWEST:
        return Code.MOVEMENTS_TOO_FEW(movements=len(found.angles), least=FEWEST)
    if not found.unknown:
        return Code.POSES_INSUFFICIENT(number=f"{found.condition:.0f}", most=f"{CONDITION:.0f}")
    name, std = found.unknown[0]
    others = len(found.unknown) - 1
    return Code.ELEMENTS_UNCERTAIN(element=name, others=others, angle_deg=f"{degrees(std):.1f}")
