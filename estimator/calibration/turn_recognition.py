"""Recognises a full turn about one device axis, or gives the reason why a movement is not one."""

from dataclasses import dataclass, field
from math import degrees, radians

import numpy as np

from bridge.reasons.codes import Code, Sentence, Sentences
from estimator.calibration.capture import Floats, Movement, Rest, TurnCapture
from estimator.calibration.clipping import ClippingKnobs, clipped
from estimator.geometry import rotation
from estimator.geometry.gyro_model import AXES


@dataclass(frozen=True, slots=True)
class TurnKnobs:
    """Limits of a full turn before the scale factors are known. Angles in rad."""

    #: range of plausible scale factors: a full turn reads between 360/1.4 and 360/0.7 degrees
    k_min: float = 0.7
    k_max: float = 1.4
    #: least share of the rotation that must be about one device axis
    axis_share: float = 0.9
    #: largest ratio of total rotation to net angle: 1 for a steady turn, more for back and forth
    detour: float = 1.25
    #: longest gap between samples, s, that integration may bridge
    gap_s: float = 0.035
    #: s, longest turn: the error from an uncertain bias grows with its duration
    longest_s: float = 15.0
    #: largest angle between gravity before and after
    tilt: float = radians(4.0)
    #: rad/s, largest difference beyond noise of the mean readings at the rests before and after: else one was no rest
    bias_step: float = radians(0.2)
    #: a smaller total rotation is a nudge, not an attempt at a turn
    nudge: float = radians(30.0)
    #: whether only turns about a horizontal axis count, where an accelerometer shows the horizon
    horizontal: bool = False
    clipping: ClippingKnobs = field(default_factory=ClippingKnobs)


@dataclass(frozen=True, slots=True)
class NoTurn:
    """A movement that was not a full turn, with the reason; `attempt` is true if it was probably meant as one.

    unit_axis: axis of a movement that would be a full turn if the readings were in other units, else None.
    """

    reason: Sentences
    attempt: bool
    unit_axis: int | None = None


def recognise(movement: Movement, k: Floats, knobs: TurnKnobs) -> TurnCapture | NoTurn:
    """Recognise a movement as a full turn, or give the reason why it is not one.

    k (3,): scale factors estimated so far, ones when nothing is known.
    """
    samples = movement.samples
    dt = rotation.intervals(samples.time)
    rate = k * (samples.gyro - movement.before.bias)
    gained = rotation.attitudes(rate, dt)[1:]
    total = np.einsum("tij,tj,t->i", gained, rate, dt)
    angle = float(np.linalg.norm(total))
    way = float(np.linalg.norm(rate, axis=1) @ dt)
    axis = int(np.argmax(np.abs(total)))
    low, high = 2 * np.pi / knobs.k_max, 2 * np.pi / knobs.k_min
    share = abs(float(total[axis])) / angle if angle else 0.0
    if way < knobs.nudge:
        small = low < degrees(angle) < high and share > knobs.axis_share and way < knobs.detour * angle
        return NoTurn((Code.NUDGE(),), attempt=False, unit_axis=axis if small else None)
    reason: Sentences = ()
    if (spoilt := clipped(samples, movement.before.std, knobs.clipping)).any():
        reason = (_spoilt(samples.gyro[spoilt]),)
    elif dt.max() > max(knobs.gap_s, 2.5 * float(np.median(dt))):
        reason = (Code.SAMPLES_MISSING(duration_s=f"{dt.max():.2f}"),)
    elif low < radians(way) < high:
        reason = (Code.MOVEMENT_IN_DEGREES(angle_deg=f"{degrees(way):.0f}"),)
    elif way > knobs.detour * angle:
        reason = (Code.BACK_AND_FORTH(way_deg=f"{degrees(way):.0f}", angle_deg=f"{degrees(angle):.0f}"),)
    elif angle < low:
        reason = (Code.TURN_TOO_SHORT(angle_deg=f"{degrees(angle):.0f}"), *_half(low < 2 * angle < high))
    elif angle > high:
        reason = (Code.TURN_TOO_LONG(angle_deg=f"{degrees(angle):.0f}"), *_half(low < angle / 2 < high))
    elif movement.after.start - movement.before.end > knobs.longest_s:
        seconds = movement.after.start - movement.before.end
        reason = (Code.TURN_TOO_SLOW(duration_s=f"{seconds:.0f}", most_s=f"{knobs.longest_s:.0f}"),)
    elif share < knobs.axis_share:
        reason = (Code.NOT_ONE_AXIS(percent=f"{100 * share:.0f}", axis=AXES[axis]),)
    else:
        reason = _rests(movement, knobs) or _tilt(movement, knobs)
    turn = TurnCapture(axis, samples, movement.before, movement.after)
    if not reason and knobs.horizontal and samples.accel is not None:
        reason = _unchecked(turn)
    return turn if not reason else NoTurn(reason, attempt=angle > low / 2)


def rough_scale(turns: tuple[TurnCapture, ...]) -> Floats:
    """Scale factors (3,) under which each turn's readings about its own axis add up to 360 degrees.

    Accurate to a percent for a turn by hand.
    """
    k = np.ones(3)
    for turn in turns:
        reading = turn.samples.gyro[:, turn.axis] - turn.before.bias[turn.axis]
        k[turn.axis] = 2 * np.pi / abs(float(reading @ rotation.intervals(turn.samples.time)))
    return k


def _spoilt(gyro: Floats) -> Sentence:
    """Reason why marked readings (n, 3) are invalid: stuck if all are equal on all axes, else too fast."""
    if len(gyro) > 1 and (gyro == gyro[0]).all():
        return Code.GYRO_STUCK(samples=len(gyro))
    return Code.TOO_FAST(samples=len(gyro))


def _half(is_so: bool) -> Sentences:  # noqa: FBT001 - a sentence or none
    return (Code.RATE_OFF_BY_TWO(),) if is_so else ()


def same_bias(a: Rest, b: Rest, knobs: TurnKnobs) -> bool:
    """Whether two rests show the same bias on every axis, within their noise (5 sigma) and `TurnKnobs.bias_step`."""
    noise = 5 * np.sqrt(np.diag(a.bias_cov + b.bias_cov))
    return bool(np.all(np.abs(a.bias - b.bias) < knobs.bias_step + noise))


def _rests(movement: Movement, knobs: TurnKnobs) -> Sentences:
    before, after = movement.before, movement.after
    if same_bias(before, after, knobs):
        return ()
    by = degrees(float(np.max(np.abs(after.bias - before.bias))))
    return (Code.RESTLESS(rate_dps=f"{by:.1f}"),)


def _tilt(movement: Movement, knobs: TurnKnobs) -> Sentences:
    if movement.before.accel is None or movement.after.accel is None:
        return ()
    tilt = rotation.angle_between(movement.before.accel, movement.after.accel)
    if tilt <= knobs.tilt:
        return ()
    return (Code.ENDED_TILTED(angle_deg=f"{degrees(tilt):.1f}"),)


def _unchecked(turn: TurnCapture) -> Sentences:
    if turn.checked_by_gravity:
        return ()
    if turn.before.accel is None or turn.after.accel is None:
        return (Code.ACCELEROMETER_BLIND(),)
    return (Code.VERTICAL_TURN(axis=AXES[turn.axis]),)
