"""Recognition of a full turn about one device axis, with the reason where a movement is not a full turn."""

from dataclasses import dataclass
from math import degrees, radians

import numpy as np

from bridge.reasons.codes import Code, Sentence, Sentences
from estimator.calibration.capture import Floats, Movement, Rest, TurnCapture
from estimator.calibration.clipping import clipped
from estimator.calibration.result import K_MAX, K_MIN
from estimator.geometry import rotation
from estimator.geometry.gyro_model import AXES

#: rad; a full turn reads between 360/1.4 and 360/0.7 degrees, before its scale factor is known
LEAST_TURN, MOST_TURN = 2 * np.pi / K_MAX, 2 * np.pi / K_MIN
#: least share of the rotation that must be about one device axis
_AXIS_SHARE = 0.9
#: largest ratio of total rotation to net angle: 1 for a steady turn, more for back and forth
_DETOUR = 1.25
#: longest gap between samples, s, that integration may bridge
GAP_S = 0.035
#: s, longest turn: the error from an uncertain bias grows with its duration
_LONGEST_S = 15.0
#: rad, largest angle between gravity before and after
_TILT = radians(4.0)
#: rad/s, largest difference beyond noise of the mean readings at the rests before and after: else one was no rest
_BIAS_STEP = radians(0.2)
#: rad; a smaller total rotation is a nudge, not an attempt at a turn
NUDGE = radians(30.0)


@dataclass(frozen=True, slots=True)
class NoTurn:
    """Movement that was not a full turn, with the reason.

    attempt: True if the movement was probably meant as a turn.
    unit_axis: axis (0 to 2) of a movement that would be a full turn if the readings were in another unit, else None.
    """

    reason: Sentences
    attempt: bool
    unit_axis: int | None = None


def recognise(movement: Movement, gyro_range: float, *, horizontal: bool) -> TurnCapture | NoTurn:
    """Recognise a movement as a full turn, or give the reason why it is not one.

    gyro_range: full-scale range, rad/s; infinite when unknown.
    horizontal: True to accept only turns about a horizontal axis, where an accelerometer shows the horizon.
    """
    samples = movement.samples
    dt = rotation.intervals(samples.time)
    rate = samples.gyro - movement.before.bias
    gained = rotation.attitudes(rate, dt)[1:]
    total = np.einsum("tij,tj,t->i", gained, rate, dt)
    angle = float(np.linalg.norm(total))
    way = float(np.linalg.norm(rate, axis=1) @ dt)
    axis = int(np.argmax(np.abs(total)))
    low, high = LEAST_TURN, MOST_TURN
    share = abs(float(total[axis])) / angle if angle else 0.0
    if way < NUDGE:
        small = low < degrees(angle) < high and share > _AXIS_SHARE and way < _DETOUR * angle
        return NoTurn((Code.NUDGE(),), attempt=False, unit_axis=axis if small else None)
    reason: Sentences = ()
    if (spoilt := clipped(samples, movement.before.std, gyro_range)).any():
        reason = (_spoilt(samples.gyro[spoilt]),)
    elif dt.max() > max(GAP_S, 2.5 * float(np.median(dt))):
        reason = (Code.SAMPLES_MISSING(duration_s=f"{dt.max():.2f}"),)
    elif low < radians(way) < high:
        reason = (Code.MOVEMENT_IN_DEGREES(angle_deg=f"{degrees(way):.0f}"),)
    elif way > _DETOUR * angle:
        reason = (Code.BACK_AND_FORTH(way_deg=f"{degrees(way):.0f}", angle_deg=f"{degrees(angle):.0f}"),)
    elif angle < low:
        reason = (Code.TURN_TOO_SHORT(angle_deg=f"{degrees(angle):.0f}"), *_half(low < 2 * angle < high))
    elif angle > high:
        reason = (Code.TURN_TOO_LONG(angle_deg=f"{degrees(angle):.0f}"), *_half(low < angle / 2 < high))
    elif movement.after.start - movement.before.end > _LONGEST_S:
        seconds = movement.after.start - movement.before.end
        reason = (Code.TURN_TOO_SLOW(duration_s=f"{seconds:.0f}", most_s=f"{_LONGEST_S:.0f}"),)
    elif share < _AXIS_SHARE:
        reason = (Code.NOT_ONE_AXIS(percent=f"{100 * share:.0f}", axis=AXES[axis]),)
    else:
        reason = _rests(movement) or _tilt(movement)
    turn = TurnCapture(axis, samples, movement.before, movement.after)
    if not reason and horizontal and samples.accel is not None:
        reason = _unchecked(turn)
    return turn if not reason else NoTurn(reason, attempt=angle > low / 2)


def rough_scale(turns: tuple[TurnCapture, ...]) -> Floats:
    """Scale factors (3,) under which each turn's readings about its own axis integrate to 360 degrees.

    The error is about 1 % for a turn by hand. An axis without a turn has 1.
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


def same_bias(a: Rest, b: Rest) -> bool:
    """Return True if two rests show the same bias on every axis, within their noise (5 sigma) plus 0.2 °/s."""
    noise = 5 * np.sqrt(np.diag(a.bias_cov + b.bias_cov))
    return bool(np.all(np.abs(a.bias - b.bias) < _BIAS_STEP + noise))


def _rests(movement: Movement) -> Sentences:
    before, after = movement.before, movement.after
    if same_bias(before, after):
        return ()
    by = degrees(float(np.max(np.abs(after.bias - before.bias))))
    return (Code.RESTLESS(rate_dps=f"{by:.1f}"),)


def _tilt(movement: Movement) -> Sentences:
    if movement.before.accel is None or movement.after.accel is None:
        return ()
    tilt = rotation.angle_between(movement.before.accel, movement.after.accel)
    if tilt <= _TILT:
        return ()
    return (Code.ENDED_TILTED(angle_deg=f"{degrees(tilt):.1f}"),)


def _unchecked(turn: TurnCapture) -> Sentences:
    if turn.checked_by_gravity:
        return ()
    if turn.before.accel is None or turn.after.accel is None:
        return (Code.ACCELEROMETER_BLIND(),)
    return (Code.VERTICAL_TURN(axis=AXES[turn.axis]),)
