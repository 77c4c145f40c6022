"""Whether gravity turns while a gyro seems to rest: slowly about a horizontal axis, which no other sensor tells from a bias."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.loops.rest import nothing_held, tilted
from estimator.track.seconds import Second

Floats = NDArray[np.float64]

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


class Tilt:
    """Quiet seconds in; whether they tilt out."""

    def __init__(self, knobs: TiltKnobs | None = None) -> None:
        self.knobs = knobs or TiltKnobs()
        self.seen = False
        self._state = nothing_held()
        self._numbers = self.knobs.over_s, self.knobs.sigmas, self.knobs.accel_floor**2, self.knobs.settled_s

    def over(self) -> None:
        """The device moves."""
        self._state[0, 0] = 0.0
        self.seen = False

    def watch(self, second: Second) -> bool:
        """Take the next second; whether gravity has turned since the device became quiet, or within over_s."""
        mean, std = second.accel_mean, second.accel_std
        if mean is None or std is None:
            return False
        found = tilted(self._state, (second.start + second.end) / 2, mean, std, second.samples, self._numbers)
        if found:
            self.seen = found > 0
        return found > 0

    def would_show(self, rate: float, second: Second) -> bool:
        """Whether a turn at such a rate, rad/s, would by the latest second have been seen."""
        seen_s = (second.start + second.end) / 2 - float(self._state[1, 0])
        least = (self.knobs.sigmas + 1) * np.sqrt(2) * self.knobs.accel_floor / G
        return bool(seen_s >= min(least / rate, self.knobs.over_s - 1.5))
