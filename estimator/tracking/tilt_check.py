"""Tilt check: whether gravity turns while the gyro seems to rest, as in a slow turn about a horizontal axis."""

from dataclasses import dataclass
from math import atan2, hypot, sqrt

import msgspec

from estimator.state import StateStruct
from estimator.tracking.seconds import Second

G = 9.80665


@dataclass(frozen=True, slots=True)
class TiltKnobs:
    """Thresholds of the tilt check."""

    #: s, longest comparison time; standard deviations of the angle beyond which the device tilts
    over_s: float = 10.0
    sigmas: float = 4.0
    #: m/s², standard deviation of a resting accelerometer's mean without tilt
    accel_floor: float = 0.01
    #: s for which gravity must stay constant after a tilt before rests are believed again
    settled_s: float = 5.0


class TiltState(StateStruct):
    """State of the tilt check.

    seen: whether gravity turns. means: recent times, s, mean readings of gravity, and their variance along an axis.
    """

    seen: bool = False
    means: list[tuple[float, tuple[float, float, float], float]] = msgspec.field(default_factory=list)


class TiltCheck:
    """Tilt check: quiet seconds in; whether the device tilts out."""

    def __init__(self, knobs: TiltKnobs | None = None) -> None:
        self.knobs = knobs or TiltKnobs()
        self.state = TiltState()

    def over(self) -> None:
        """Forget the gravity readings compared so far, because the device moves."""
        self.state = TiltState()

    def watch(self, second: Second) -> bool:
        """Add a quiet second; returns whether gravity has turned since the device became quiet, or within over_s.

        False without accelerometer readings.
        """
        if second.accel_mean is None or second.accel_std is None:
            return False
        state, knobs, now = self.state, self.knobs, (second.start + second.end) / 2
        a, b, c = second.accel_mean.tolist()
        square = a * a + b * b + c * c
        x, y, z = second.accel_std.tolist()
        var, means = (x * x + y * y + z * z) / (3 * second.samples) + knobs.accel_floor**2, state.means
        while means and now - means[0][0] > knobs.over_s:
            del means[0]
        turned = False
        if means:
            begun, (x, y, z), var_then = means[0]
            crossed = hypot(y * c - z * b, z * a - x * c, x * b - y * a)
            turned = atan2(crossed, x * a + y * b + z * c) > knobs.sigmas * sqrt((var + var_then) / square)
            if turned:
                means.clear()
                state.seen = True
            elif now - begun >= knobs.settled_s:
                state.seen = False
        means.append((now, (a, b, c), var))
        return turned

    def would_show(self, rate: float, second: Second) -> bool:
        """Whether a tilting turn at this rate, rad/s, would have been noticed by the end of this second."""
        means = self.state.means
        seen_s = (second.start + second.end) / 2 - (means[0][0] if means else 0.0)
        least = (self.knobs.sigmas + 1) * sqrt(2) * self.knobs.accel_floor / G
        return bool(seen_s >= min(least / rate, self.knobs.over_s - 1.5))
