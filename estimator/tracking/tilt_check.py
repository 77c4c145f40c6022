"""Tilt check: detects that gravity turns while the gyro seems to rest, as in a slow turn about a horizontal axis."""

from math import atan2, hypot, sqrt

import msgspec

from estimator.state import StateStruct
from estimator.tracking.seconds import Second

G = 9.80665
#: s, longest comparison time; standard deviations of the angle beyond which the device tilts
OVER_S, SIGMAS = 10.0, 4.0
#: m/s², standard deviation of a resting accelerometer's mean without tilt
ACCEL_FLOOR = 0.01
#: s for which gravity must stay constant after a tilt before rests are believed again
SETTLED_S = 5.0


class TiltCheck(StateStruct):
    """Tilt check: takes quiet one-second blocks, and detects a slow tilt of the device; replaced by a new one on movement.

    seen: True while gravity turns, and until it was constant for 5 s.
    means: blocks of the last 10 s, as tuples of device time (s), mean accelerometer reading (3) m/s², and its variance
        per axis, m²/s⁴.
    """

    seen: bool = False
    means: list[tuple[float, tuple[float, float, float], float]] = msgspec.field(default_factory=list)

    def watch(self, second: Second) -> bool:
        """Add a quiet one-second block; return True if gravity has turned since the first block of the last 10 s.

        Gravity has turned if the angle exceeds 4 of its standard deviations. False without accelerometer readings.
        """
        if second.accel_mean is None or second.accel_std is None:
            return False
        now, means = (second.start + second.end) / 2, self.means
        a, b, c = second.accel_mean.tolist()
        square = a * a + b * b + c * c
        x, y, z = second.accel_std.tolist()
        var = (x * x + y * y + z * z) / (3 * second.samples) + ACCEL_FLOOR**2
        while means and now - means[0][0] > OVER_S:
            del means[0]
        turned = False
        if means:
            begun, (x, y, z), var_then = means[0]
            crossed = hypot(y * c - z * b, z * a - x * c, x * b - y * a)
            turned = atan2(crossed, x * a + y * b + z * c) > SIGMAS * sqrt((var + var_then) / square)
            if turned:
                means.clear()
                self.seen = True
            elif now - begun >= SETTLED_S:
                self.seen = False
        means.append((now, (a, b, c), var))
        return turned

    def would_show(self, rate: float, second: Second) -> bool:
        """Return True if the check would already have detected a tilting turn at this rate, rad/s, by the end of the block."""
        seen_s = (second.start + second.end) / 2 - (self.means[0][0] if self.means else 0.0)
        least = (SIGMAS + 1) * sqrt(2) * ACCEL_FLOOR / G
        return bool(seen_s >= min(least / rate, OVER_S - 1.5))
