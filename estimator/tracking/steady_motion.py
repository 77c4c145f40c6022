"""Detection of steady motion: a walker, with a velocity that stays the same over many seconds.

The gravity evidence measures the mean velocity of each second as zero, with an independent error. A walker's velocity
persists, so the errors of n seconds are one error rather than n. The innovations (m/s) reveal this by their
correlation:

    c = mean over the last minute of (innovation · the one before, in the same axes) / (3 R)

R is the variance of the measurement, (m/s)² per axis; c has no unit. In a walk c is about 0.2 while the filter explains
the velocity by a tilt, and 0.6 once it does not. For a wearer who moves about in one place c stays below 0.1, however
fast. Where c exceeds 0.1, R is multiplied by 1 + 200 (c - 0.1), at most 160. As R grows, a walk shows more in c.
Source: innovation correlation as a measure of R, R. K. Mehra, "On the identification of variances and adaptive Kalman
filtering", IEEE Trans. Automatic Control 15 (1970). The coefficients come from tests/bench/honesty.py and
tests/bench/tracking.py.
"""

from estimator.state import Floats, StateStruct

#: s of movement over which c is averaged
_MEMORY_S = 60.0
#: c of motion in one place; growth of R for each 1 of c above it; largest factor of R
_BOUNDED, _GROWTH, _MOST = 0.1, 200.0, 160.0
#: limit of one second's contribution to c: a fall is no walk
_ONE = 2.0


class SteadyMotion(StateStruct):
    """Steady-motion detector: takes one velocity innovation per second of movement, and gives a factor for its variance R.

    shared: innovation correlation c (see the module), no unit.
    before: the previous innovation, m/s, or None.
    """

    shared: float = 0.0
    before: tuple[float, float, float] | None = None

    @property
    def factor(self) -> float:
        """Factor, 1 to 160, no unit, by which R must be enlarged because successive velocity errors are correlated.

        R is the variance of the measured velocity, (m/s)², under the assumption of errors that are independent from
        second to second.
        """
        return min(_MOST, 1.0 + _GROWTH * max(0.0, self.shared - _BOUNDED))

    def heard(self, innovation: Floats, var: float, end: Floats, seconds: float) -> None:
        """Add the velocity innovation (3,), m/s, of a span, in sensor axes at the span's end.

        var: variance of the measurement before `factor`, (m/s)² per axis.
        end (3, 3): rotation from sensor axes at the span's end to those at its start.
        seconds: length of the span, s.
        """
        a, b, c = innovation.tolist()
        if self.before is not None:
            # end' before · now: for three numbers plain Python is faster than NumPy.
            (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = end.tolist()
            x, y, z = self.before
            along = a * (x * xx + y * yx + z * zx) + b * (x * xy + y * yy + z * zy) + c * (x * xz + y * yz + z * zz)
            shared = along / (3 * var)
            self.shared += min(1.0, seconds / _MEMORY_S) * (max(-_ONE, min(_ONE, shared)) - self.shared)
        self.before = a, b, c
