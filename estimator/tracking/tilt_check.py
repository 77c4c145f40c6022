"""Whether gravity turns while the gyro seems to rest: a slow turn about a horizontal axis."""

from dataclasses import dataclass
from math import atan2, hypot, sqrt

import msgspec

from estimator.state import StateStruct
from estimator.tracking.seconds import Second

G = 9.80665


@dataclass(frozen=True, slots=True)
class TiltKnobs:
    """When a device tilts."""

    #: judged over this long, s, and noticed beyond so many standard deviations
    over_s: float = 10.0
    sigmas: float = 4.0
    #: m/s², what moves a resting accelerometer's mean without any tilt
    accel_floor: float = 0.01
    #: after a tilt nothing is believed until gravity has stayed for this long
    settled_s: float = 5.0


class TiltState(StateStruct):
    """seen: whether gravity turns. means: of the last while, time, mean of gravity's reading, variance of it along an axis."""

    seen: bool = False
    means: list[tuple[float, tuple[float, float, float], float]] = msgspec.field(default_factory=list)


class TiltCheck:
    """Quiet seconds in; whether they tilt out."""

    def __init__(self, knobs: TiltKnobs | None = None) -> None:
        self.knobs = knobs or TiltKnobs()
        self.state = TiltState()

    def over(self) -> None:
        """The device moves."""
        self.state = TiltState()

    def watch(self, second: Second) -> bool:
        """Take the next second; whether gravity has turned since the device became quiet, or within over_s."""
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
        """Whether a turn at such a rate, rad/s, would by the latest second have been seen."""
        means = self.state.means
        seen_s = (second.start + second.end) / 2 - (means[0][0] if means else 0.0)
        least = (self.knobs.sigmas + 1) * sqrt(2) * self.knobs.accel_floor / G
        return bool(seen_s >= min(least / rate, self.knobs.over_s - 1.5))
