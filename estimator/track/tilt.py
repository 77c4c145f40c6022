"""Whether gravity turns while a gyro seems to rest: slowly about a horizontal axis, which no other sensor tells from a bias."""

from collections import deque
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from estimator.rotation import angle_between
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
        self._held: deque[tuple[float, Floats, float]] = deque()  # of this rest: when, mean acceleration, its variance

    def over(self) -> None:
        """The device moves."""
        self._held.clear()
        self.seen = False

    def watch(self, second: Second) -> bool:
        """Take the next second; whether gravity has turned since the device became quiet, or within over_s."""
        knobs = self.knobs
        mean, std = second.accel_mean, second.accel_std
        if mean is None or std is None:
            return False
        var = _square(std) / (3 * second.samples) + knobs.accel_floor**2
        now = (second.start + second.end) / 2
        while self._held and now - self._held[0][0] > knobs.over_s:
            self._held.popleft()
        turned = False
        if self._held:
            since, first, first_var = self._held[0]
            error = sqrt((var + first_var) / _square(mean))
            if angle_between(first, mean) > knobs.sigmas * error:
                self.seen = turned = True
                self._held.clear()
            elif now - since >= knobs.settled_s:
                self.seen = False
        self._held.append((now, mean, var))
        return turned

    def would_show(self, rate: float, second: Second) -> bool:
        """Whether a turn at such a rate, rad/s, would by the latest second have been seen."""
        seen_s = (second.start + second.end) / 2 - self._held[0][0]
        least = (self.knobs.sigmas + 1) * np.sqrt(2) * self.knobs.accel_floor / G
        return bool(seen_s >= min(least / rate, self.knobs.over_s - 1.5))


def _square(vector: Floats) -> float:
    a, b, c = vector.tolist()
    return float(a * a + b * b + c * c)
