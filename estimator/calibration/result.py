"""The outcome of a calibration: estimate, covariance, residuals, verdict and the reason for it."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, radians

import numpy as np

from bridge.reasons.codes import Code, Sentence, Sentences
from bridge.wire.messages import Turn, Verdict
from estimator.calibration.capture import Capture, Floats, TurnCapture
from estimator.geometry import rotation
from estimator.geometry.gyro_model import AXES, PriorKnobs, axis_names, reading_std

PARAMETERS = ("bias_x", "bias_y", "bias_z", "k_x", "k_y", "k_z")


@dataclass(frozen=True, slots=True)
class VerdictKnobs:
    """What is accepted."""

    k_min: float = 0.7
    k_max: float = 1.4
    #: rad between start and end of a turn, corrected; a hand that wobbles 3° leaves Algorithm 1 up to 4° off
    closure: float = radians(5.0)
    #: relative; more than this and the three turns did not determine the scale
    scale_std: float = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """corrected = matrix (reading - bias). matrix (3, 3), bias (3,) rad/s, covariance (p, p) of `parameters`.

    The first six parameters are always the bias and the diagonal of the matrix; a full matrix has its other elements after.

    Without an estimate (verdict repeat or refused before a method could run) matrix is the identity, the covariance all
    infinite.
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

    @property
    def scale(self) -> Floats:
        """(3,) the diagonal of the matrix."""
        return np.diag(self.matrix).copy()

    @property
    def information_bits(self) -> Floats:
        """(p,) what the session told of each parameter: the halvings of what was believed before it, see PriorKnobs."""
        prior = PriorKnobs()
        of = {"bias": prior.bias_std, "k": prior.scale_std, "m": prior.misalignment_std}
        before = np.array([of[name.split("_")[0]] for name in self.parameters])
        return np.asarray(np.log2(before / np.sqrt(np.diag(self.covariance))))

    @property
    def scale_std(self) -> Floats:
        """(3,) relative standard deviation of the scale factors."""
        std: Floats = np.sqrt(np.diag(self.covariance)[3:6]) / np.abs(self.scale)
        return std


def nothing(method: str, verdict: Verdict, reason: Sentences, repeat: tuple[int, ...] = ()) -> Result:
    """A result without an estimate."""
    unknown = np.full((6, 6), np.inf)
    return Result(method, verdict, reason, np.eye(3), np.zeros(3), unknown, np.full(3, np.inf), (), repeat)


def turn_report(turn: TurnCapture, matrix: Floats, bias: Floats) -> Turn:
    """Angle turned about the axis and closure error of one turn under a calibration."""
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
    knobs: VerdictKnobs | None = None,
    *,
    turn_bias: Floats | None = None,
    unclosed: Floats | None = None,
    bias_time: float | None = None,
    note: Sentences = (),
) -> Result:
    """Put a verdict on scale factors k (3,) and bias (3,) with covariance (6, 6).

    A method may know better than one bias and closed turns: turn_bias (3, 3) rad/s, the bias during each turn;
    unclosed (3,) rad, by what each misses.
    bias_time: when the bias was so, by default in the middle of the first rest. note: what to add to the reason for accepting.
    """
    knobs = knobs or VerdictKnobs()
    turn_bias = np.tile(bias, (3, 1)) if turn_bias is None else turn_bias
    matrix, noise_std = np.diag(k), reading_std(capture.rest.std)
    turns = tuple(turn_report(turn, matrix, b) for turn, b in zip(capture.turns, turn_bias, strict=True))
    missed = np.array([turn.closure_error for turn in turns]) if unclosed is None else unclosed
    is_open = missed > knobs.closure
    open_axes = tuple(turn.axis for turn, is_so in zip(turns, is_open, strict=True) if is_so)
    loose = tuple(axis for axis in range(3) if not np.sqrt(covariance[3 + axis, 3 + axis]) < knobs.scale_std)
    outside = unbelievable(k, knobs)
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


def unbelievable(k: Floats, knobs: VerdictKnobs) -> tuple[tuple[int, ...], Sentences] | None:
    """Which of the scale factors k (3,) are outside what is accepted, and the likely cause; None when all are inside."""
    outside = tuple(axis for axis in range(3) if not knobs.k_min <= k[axis] <= knobs.k_max)
    if not outside:
        return None
    return outside, (Code.SCALE_OUTSIDE(scale=_values(k), least=knobs.k_min, most=knobs.k_max), _likely(k))


def unlikely(k: Floats, limit: float) -> tuple[tuple[int, ...], Sentences] | None:
    """Of which axes rather the turn was no full one than the gyro so far off, its limit being known (relative); None of none.

    What all axes have in common is no turn's fault: a library's sensitivity, or a sample rate.
    """
    common = float(np.median(k))
    off = np.where(np.abs(k - 1) < np.abs(k / common - 1), k, k / common)
    odd = tuple(axis for axis in range(3) if abs(off[axis] - 1) > limit)
    if not odd:
        return None
    turned = ", ".join(f"{AXES[axis]} {360 / off[axis]:.0f}°" for axis in odd)
    return odd, (Code.NOT_ONE_TURN(turns=turned, axes=axis_names(odd)),)


def _unchecked(turns: Sequence[TurnCapture]) -> Sentences:
    """What the result rests on because nothing measured it: the angle of turns that gravity does not check."""
    unchecked = [turn for turn in turns if not turn.checked_by_gravity]
    if not unchecked:
        return ()
    if any(turn.before.accel is None for turn in unchecked):
        return (Code.TURNS_ASSUMED(),)
    return (Code.VERTICAL_TURNS_ASSUMED(axes=axis_names(turn.axis for turn in unchecked)),)


def _library(k: Floats) -> Sentences:
    """What common libraries get wrong: the LSM9DS1's sensitivity is not its range over 32768."""
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
