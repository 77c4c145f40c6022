"""Steady motion: detects a walker, whose velocity stays the same from second to second and then says little.

Gravity's evidence takes the mean velocity of each second as zero, with an error. A walker's velocity is that of many seconds
before: n of them tell no more than one, until a corner changes it and shows that all were wrong alike. The innovations show
this. The product of neighbouring innovations, in the same axes, relative to the measurement's variance R,

    c = mean over the last minute of (innovation · the one before) / (3 R),

is about 0.2 in a walk while the filter takes the walker's velocity for a tilt and hides it; 0.6 once the filter no longer does.
For a wearer who moves about in one place c stays below 0.1, however fast. R grows with the excess of c over that; the more R
has grown, the more of a walk c shows.
Source: innovation correlation as a measure of R, R. K. Mehra, "On the identification of variances and adaptive Kalman
filtering", IEEE Trans. Automatic Control 15 (1970); the coefficients from tests/bench/honesty.py and tests/bench/tracking.py.
"""

from estimator.state import Floats, StateStruct

#: s of movement over which c is averaged
_MEMORY_S = 60.0
#: c of motion in one place; growth of R for each 1 of c above it; largest factor of R
_BOUNDED, _GROWTH, _MOST = 0.1, 200.0, 160.0
#: limit of one second's contribution to c: a fall is no walk
_ONE = 2.0


class SteadyMotion(StateStruct):
    """Steady motion detector: takes a velocity innovation per second of movement, gives the factor for its variance.

    shared: innovation correlation c. before: the previous innovation, m/s, or None.
    """

    shared: float = 0.0
    before: tuple[float, float, float] | None = None

    @property
    def factor(self) -> float:
        """Factor, at least 1, by which R exceeds that of a velocity independent from second to second."""
        return min(_MOST, 1.0 + _GROWTH * max(0.0, self.shared - _BOUNDED))

    def heard(self, innovation: Floats, var: float, end: Floats, seconds: float) -> None:
        """Add the velocity innovation (3,) m/s of a span, in axes at the span's end.

        var: variance of the measurement before `factor`, (m/s)². end (3, 3): attitude of the span's end in axes of its
        begin. seconds: length of the span.
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
