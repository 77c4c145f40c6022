"""Is a movement a full turn about one axis of the device? If not, why not, in words for who turned it."""

from dataclasses import dataclass, field
from math import degrees, radians

import numpy as np

from estimator import rotation
from estimator.batch.capture import Floats, Movement, Rest, TurnCapture
from estimator.batch.clipping import ClippingKnobs, clipped
from estimator.gyro import AXES


@dataclass(frozen=True, slots=True)
class TurnKnobs:
    """What a full turn looks like before the scale factors are known. Angles in rad."""

    #: a believable scale factor; a full turn then reads between 360/1.4 and 360/0.7 degrees
    k_min: float = 0.7
    k_max: float = 1.4
    #: least part of the rotation about one device axis
    axis_share: float = 0.9
    #: the way turned over the angle gained: 1 for a steady turn, more when it went back and forth
    detour: float = 1.25
    #: seconds without samples that integration may bridge
    gap_s: float = 0.035
    #: a longer movement is no turn: what is not known of the bias grows with it
    longest_s: float = 15.0
    #: how far gravity before and after may differ
    tilt: float = radians(4.0)
    #: how far the readings at rest before and after may differ, rad/s, beyond their noise: else one was no rest
    bias_step: float = radians(0.2)
    #: below this it was a nudge and no try at a turn
    nudge: float = radians(30.0)
    #: whether only turns about a horizontal axis count, where an accelerometer tells which those are
    horizontal: bool = False
    clipping: ClippingKnobs = field(default_factory=ClippingKnobs)


@dataclass(frozen=True, slots=True)
class NoTurn:
    """A movement that was not a full turn; `attempt` tells whether somebody probably meant one.

    In other units it may have been one: then `unit_axis` is the axis it was about, else None.
    """

    reason: str
    attempt: bool
    unit_axis: int | None = None


def recognise(movement: Movement, k: Floats, knobs: TurnKnobs) -> TurnCapture | NoTurn:
    """The turn that a movement was; k (3,) are the scale factors believed so far (ones when nothing is known)."""
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
        return NoTurn("a nudge, not a turn", attempt=False, unit_axis=axis if small else None)
    reason = None
    if (spoilt := clipped(samples, movement.before.std, knobs.clipping)).any():
        reason = _spoilt(samples.gyro[spoilt])
    elif dt.max() > max(knobs.gap_s, 2.5 * float(np.median(dt))):
        reason = f"{dt.max():.2f} s of samples are missing in the turn: check the connection and repeat"
    elif low < radians(way) < high:
        reason = f"{degrees(way):.0f}° of movement: the readings are probably degrees per second, given as rad/s"
    elif way > knobs.detour * angle:
        reason = f"went back and forth: {degrees(way):.0f}° of movement gained {degrees(angle):.0f}°"
    elif angle < low:
        reason = f"a movement of {degrees(angle):.0f}°, not a full turn of 360°" + _half(low < 2 * angle < high)
    elif angle > high:
        reason = f"a movement of {degrees(angle):.0f}°, more than one full turn of 360°" + _half(low < angle / 2 < high)
    elif movement.after.start - movement.before.end > knobs.longest_s:
        seconds = movement.after.start - movement.before.end
        reason = f"a turn that took {seconds:.0f} s: turn in less than {knobs.longest_s:.0f} s"
    elif share < knobs.axis_share:
        reason = f"not about one axis of the device: {100 * share:.0f} % about {AXES[axis]}"
    else:
        reason = _rests(movement, knobs) or _tilt(movement, knobs)
    turn = TurnCapture(axis, samples, movement.before, movement.after)
    if reason is None and knobs.horizontal and samples.accel is not None:
        reason = _unchecked(turn)
    return turn if reason is None else NoTurn(reason, attempt=angle > low / 2)


def rough_scale(turns: tuple[TurnCapture, ...]) -> Floats:
    """(3,) what makes each turn's readings about its own axis add up to 360 degrees; within a percent for a hand's turn."""
    k = np.ones(3)
    for turn in turns:
        reading = turn.samples.gyro[:, turn.axis] - turn.before.bias[turn.axis]
        k[turn.axis] = 2 * np.pi / abs(float(reading @ rotation.intervals(turn.samples.time)))
    return k


def _spoilt(gyro: Floats) -> str:
    """Why readings (n, 3) that are marked are no measurement: all alike on all axes, they are stuck."""
    if len(gyro) > 1 and (gyro == gyro[0]).all():
        return (
            f"the gyro repeated itself for {len(gyro)} samples: turn again; if this is said again, restart the device"
        )
    return f"turned faster than the gyro's range for {len(gyro)} samples: turn more slowly"


def _half(is_so: bool) -> str:  # noqa: FBT001 - a sentence or none
    return "; if it was just one, the sample rate is off by a factor of two" if is_so else ""


def same_bias(a: Rest, b: Rest, knobs: TurnKnobs) -> bool:
    """Whether two rests show the same bias, within their noise and what a bias may move meanwhile."""
    noise = 5 * np.sqrt(np.diag(a.bias_cov + b.bias_cov))
    return bool(np.all(np.abs(a.bias - b.bias) < knobs.bias_step + noise))


def _rests(movement: Movement, knobs: TurnKnobs) -> str | None:
    before, after = movement.before, movement.after
    if same_bias(before, after, knobs):
        return None
    by = degrees(float(np.max(np.abs(after.bias - before.bias))))
    return f"the rests before and after read {by:.1f} °/s apart: one was a slow movement; hold it quite still"


def _tilt(movement: Movement, knobs: TurnKnobs) -> str | None:
    if movement.before.accel is None or movement.after.accel is None:
        return None
    tilt = rotation.angle_between(movement.before.accel, movement.after.accel)
    if tilt <= knobs.tilt:
        return None
    return f"ended tilted {degrees(tilt):.1f}° from where it began: put it back against the same edge"


def _unchecked(turn: TurnCapture) -> str | None:
    if turn.checked_by_gravity:
        return None
    if turn.before.accel is None or turn.after.accel is None:
        return "the accelerometer does not read gravity at rest, so it checks no turn: check its unit and its range"
    return (
        f"gravity does not check a turn about the vertical: stand the device so that {AXES[turn.axis]} is level first"
    )
