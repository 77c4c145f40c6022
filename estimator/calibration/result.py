"""Result of a calibration: estimate, covariance, verdict and the reason for the verdict."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, radians

import numpy as np

from bridge.reasons.codes import Code, Sentence, Sentences
from bridge.wire.messages import AccelerometerCalibration, Turn, Verdict
from estimator.calibration.capture import Capture, Floats, TurnCapture
from estimator.geometry import rotation
from estimator.geometry.gyro_model import AXES, PriorKnobs, axis_names, reading_std

#: verdict against a fit, axes of the turns to repeat, and the reason
Objection = tuple[Verdict, tuple[int, ...], Sentences]
PARAMETERS = ("bias_x", "bias_y", "bias_z", "k_x", "k_y", "k_z")

#: range of plausible scale factors
K_MIN, K_MAX = 0.7, 1.4
#: rad, closure error of a corrected turn; a hand that wobbles 3° leaves Algorithm 1 up to 4° off
_CLOSURE = radians(5.0)
#: relative; above this the three turns did not determine the scale
SCALE_STD = 0.02


class NotConverged(Exception):
    """Raised when the fit of bias and scale factors to three turns does not converge; `reason` is the text for users."""

    def __init__(self, reason: Sentence) -> None:
        super().__init__(reason)
        self.reason = reason


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """Outcome of a calibration, with corrected rate = matrix (reading - bias) in rad/s.

    method, verdict, reason: name of the method, its verdict, and the reason as text for users.
    matrix (3, 3), no unit; bias (3,) rad/s; both in sensor axes.
    covariance (p, p): of `parameters`, bias in rad/s and matrix elements without unit.
    noise_std (3,): standard deviation of one reading, rad/s.
    turns: angle (rad), closure error (rad) and duration (s) of each turn. repeat: axes (0 to 2) of the turns to repeat.
    bias_time: device time to which the bias refers, s.
    accelerometer: calibration of the accelerometer from the rests of the same recording. None without an accelerometer,
        and None for a live session.
    The first six parameters are always the bias and the diagonal of the matrix. A full matrix adds its off-diagonal
    elements.
    A result without an estimate has the identity as matrix and an infinite covariance.
    """

    method: str
    verdict: Verdict
    reason: Sentences
    matrix: Floats
    bias: Floats
    covariance: Floats
    noise_std: Floats
    turns: tuple[Turn, ...] = ()
    repeat: tuple[int, ...] = ()
    bias_time: float = 0.0
    parameters: tuple[str, ...] = PARAMETERS
    accelerometer: AccelerometerCalibration | None = None

    @property
    def scale(self) -> Floats:
        """Scale factors (3,), no unit: the diagonal of the matrix."""
        return np.diag(self.matrix).copy()

    @property
    def information_bits(self) -> Floats:
        """Information (p,) gained on each parameter, bits: log2 of the ratio of its standard deviations before and after.

        PriorKnobs gives the standard deviations before the calibration.
        """
        prior = PriorKnobs()
        of = {"bias": prior.bias_std, "k": prior.scale_std, "m": prior.misalignment_std}
        before = np.array([of[name.split("_")[0]] for name in self.parameters])
        return np.asarray(np.log2(before / np.sqrt(np.diag(self.covariance))))

    @property
    def scale_std(self) -> Floats:
        """Relative standard deviation (3,) of the scale factors."""
        std: Floats = np.sqrt(np.diag(self.covariance)[3:6]) / np.abs(self.scale)
        return std


def nothing(method: str, verdict: Verdict, reason: Sentences, repeat: tuple[int, ...] = ()) -> Result:
    """Build the result of a calibration without an estimate: identity matrix, zero bias, infinite covariance.

    repeat: axes (0 to 2) of the turns to repeat.
    """
    unknown = np.full((6, 6), np.inf)
    return Result(method, verdict, reason, np.eye(3), np.zeros(3), unknown, np.full(3, np.inf), (), repeat)


def turn_report(turn: TurnCapture, matrix: Floats, bias: Floats) -> Turn:
    """Report one turn under a calibration: signed angle about its axis (rad), closure error (rad) and duration (s).

    matrix (3, 3) and bias (3,) rad/s: corrected = matrix (reading - bias).
    The closure error is the angle between start and end attitude.
    """
    dt = rotation.intervals(turn.samples.time)
    rate = (turn.samples.gyro - bias) @ matrix.T
    path = rotation.attitudes(rate, dt)
    along = np.einsum("tij,tj,t->i", path[1:], rate, dt)
    angle = float(np.copysign(np.linalg.norm(along), along[turn.axis]))
    return Turn(turn.axis, angle, float(np.linalg.norm(rotation.log(path[-1]))), turn.after.start - turn.before.end)


def judge(
    method: str,
    capture: Capture,
    k: Floats,
    bias: Floats,
    covariance: Floats,
    *,
    closure: float = _CLOSURE,
    turn_bias: Floats | None = None,
    unclosed: Floats | None = None,
    bias_time: float | None = None,
    note: Sentences = (),
) -> Result:
    """Give a verdict on a diagonal calibration: scale factors k (3,) and bias (3,) rad/s with covariance (6, 6).

    method: name for the result.
    covariance (6, 6): in the order bias (rad/s), k (no unit).
    closure: largest accepted closure error of a turn, rad.
    turn_bias (3, 3): bias during each turn, rad/s; by default `bias` in all turns.
    unclosed (3,): closure error of each turn, rad; by default computed from the turn's path.
    bias_time: device time to which the bias refers, s; by default the middle of the first rest.
    note: added to the reason of an accepted result.
    Verdict REFUSED: implausible scale factors. REPEAT: a turn did not close, or a scale factor is uncertain by 0.02 or
    more.
    """
    turn_bias = np.tile(bias, (3, 1)) if turn_bias is None else turn_bias
    matrix, noise_std = np.diag(k), reading_std(capture.rest.std)
    turns = tuple(turn_report(turn, matrix, b) for turn, b in zip(capture.turns, turn_bias, strict=True))
    missed = np.array([turn.closure_error for turn in turns]) if unclosed is None else unclosed
    is_open = missed > closure
    open_axes = tuple(turn.axis for turn, is_so in zip(turns, is_open, strict=True) if is_so)
    loose = tuple(axis for axis in range(3) if not np.sqrt(covariance[3 + axis, 3 + axis]) < SCALE_STD)
    outside = unbelievable(k)
    reason: Sentences
    if outside is not None:
        verdict, repeat, reason = Verdict.REFUSED, *outside
    elif open_axes:
        verdict, repeat = Verdict.REPEAT, open_axes
        errors = ", ".join(f"{AXES[t.axis]} {degrees(missed[i]):.1f}°" for i, t in enumerate(turns) if is_open[i])
        reason = (Code.TURNS_OPEN(errors=errors, axes=axis_names(open_axes)),)
    elif loose:
        verdict, repeat = Verdict.REPEAT, loose
        reason = (Code.SCALE_UNCERTAIN(axes=axis_names(loose)),)
    else:
        verdict, repeat = Verdict.ACCEPTED, ()
        worst = max(degrees(t.closure_error) for t in turns)
        reason = (Code.TURNS_CLOSED(angle_deg=f"{worst:.2f}"), *_unchecked(capture.turns), *note, *_library(k))
    bias_time = capture.rest.middle if bias_time is None else bias_time
    return Result(method, verdict, reason, matrix, bias, covariance, noise_std, turns, repeat, bias_time)


def unbelievable(k: Floats) -> tuple[tuple[int, ...], Sentences] | None:
    """Axes whose scale factor is outside 0.7 to 1.4, and the reason text with its likely cause; None when all are inside.

    k (3,): scale factors, no unit.
    """
    outside = tuple(axis for axis in range(3) if not K_MIN <= k[axis] <= K_MAX)
    if not outside:
        return None
    return outside, (Code.SCALE_OUTSIDE(scale=_values(k), least=K_MIN, most=K_MAX), _likely(k))


def concluded(k: Floats, reason: Sentences, *objections: Objection | None) -> Objection:
    """Return a fit's verdict, the axes (0 to 2) whose turns must be repeated, and the reason text.

    k (3,): scale factors; values outside 0.7 to 1.4 give REFUSED.
    reason: text for an accepted fit.
    objections: checks in order of priority; None for a passed check. The first one that is not None decides.
    """
    if (outside := unbelievable(k)) is not None:
        return Verdict.REFUSED, *outside
    return next((one for one in objections if one is not None), (Verdict.ACCEPTED, (), reason))


def unlikely(k: Floats, limit: float) -> tuple[tuple[int, ...], Sentences] | None:
    """Axes whose turn was probably not a full turn, since the scale factor is too far from 1, and the reason text.

    k (3,): scale factors.
    limit: largest plausible relative difference from 1.
    Returns None when there are no such axes. A deviation that all axes share is ignored. Its cause is a wrong sample
    rate, or a wrong conversion of the gyro's raw values to rad/s.
    """
    common = float(np.median(k))
    off = np.where(np.abs(k - 1) < np.abs(k / common - 1), k, k / common)
    odd = tuple(axis for axis in range(3) if abs(off[axis] - 1) > limit)
    if not odd:
        return None
    turned = ", ".join(f"{AXES[axis]} {360 / off[axis]:.0f}°" for axis in odd)
    return odd, (Code.NOT_ONE_TURN(turns=turned, axes=axis_names(odd)),)


def _unchecked(turns: Sequence[TurnCapture]) -> Sentences:
    """Reason text for turns whose angle gravity does not check, so that the result assumes full turns."""
    unchecked = [turn for turn in turns if not turn.checked_by_gravity]
    if not unchecked:
        return ()
    if any(turn.before.accel is None for turn in unchecked):
        return (Code.TURNS_ASSUMED(),)
    return (Code.VERTICAL_TURNS_ASSUMED(axes=axis_names(turn.axis for turn in unchecked)),)


def _library(k: Floats) -> Sentences:
    """Known sensitivity errors of common libraries: the LSM9DS1's sensitivity is not its range over 32768."""
    for factor in (1.147, 1.170):
        if np.all(np.abs(k / factor - 1) < 0.01):
            return (Code.LIBRARY_SENSITIVITY(factor=factor),)
    return ()


def _likely(k: Floats) -> Sentence:
    mean = float(np.mean(k))
    if abs(mean - 2) < 0.2 or abs(mean - 0.5) < 0.05:
        return Code.RATE_WRONG()
    if np.all(np.abs(np.log(np.maximum(k, 1e-9) * np.pi / 180)) < 0.4) or np.all(
        np.abs(np.log(np.maximum(k, 1e-9) * 180 / np.pi)) < 0.4
    ):
        return Code.UNIT_WRONG()
    return Code.SENSITIVITY_WRONG()


def _values(k: Floats) -> str:
    return ", ".join(f"{AXES[i]} {k[i]:.3f}" for i in range(3))
