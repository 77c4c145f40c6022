"""Steady motion: a walker goes on alike from second to second, and his velocity then says little.

Gravity measures the mean velocity of each second as zero with an error of its own. A walker's is that of the second before, and
of many before that: n of them tell no more than one, until a corner changes it and all of them were wrong by the same. It shows
in the innovations: what two neighbours share, in the same axes, as a part of what the measurement's variance R lets each be,

    c = mean over the last minute of (innovation · the one before) / (3 R),

is some 0.2 in a walk already while the filter takes the walker's velocity for a tilt and hides it, 0.6 when it no longer does.
Who moves about in one place stays below 0.1, as fast as he may be. R grows with what c is above that; the more it has grown, the
more of a walk c shows.
Source: innovation correlation as a measure of R, R. K. Mehra, "On the identification of variances and adaptive Kalman
filtering", IEEE Trans. Automatic Control 15 (1970); the coefficients from tests/bench/honesty.py and tests/bench/tracking.py.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.state import StateStruct

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SteadyMotionKnobs:
    """What neighbours share, c, and what follows from it."""

    #: s of movement that c is the mean of
    memory_s: float = 60.0
    #: c of who moves about in one place, and how far R grows for each 1 of c above it, at the most so many times
    bounded: float = 0.1
    growth: float = 200.0
    most: float = 160.0
    #: what one second counts for at the most: a fall is no walk
    one: float = 2.0


class SteadyMotionState(StateStruct):
    """shared: c. before: the innovation before, m/s."""

    shared: float = 0.0
    before: tuple[float, float, float] | None = None


class SteadyMotion:
    """Innovations in, one a second of movement; how much larger R is to be out."""

    def __init__(self, knobs: SteadyMotionKnobs | None = None) -> None:
        self.knobs = knobs or SteadyMotionKnobs()
        self.state = SteadyMotionState()

    @property
    def factor(self) -> float:
        """How many times R is what it would be of a velocity that is another each second."""
        knobs = self.knobs
        return min(knobs.most, 1.0 + knobs.growth * max(0.0, self.state.shared - knobs.bounded))

    def heard(self, innovation: Floats, var: float, end: Floats, seconds: float) -> None:
        """Take the next innovation (3,) m/s, in axes of its span's end (3, 3), of a measurement of variance var unmultiplied."""
        state, (a, b, c) = self.state, innovation.tolist()
        if state.before is not None:
            # end' before · now: of three numbers Python is quicker than NumPy.
            (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = end.tolist()
            x, y, z = state.before
            along = a * (x * xx + y * yx + z * zx) + b * (x * xy + y * yy + z * zy) + c * (x * xz + y * yz + z * zz)
            shared = along / (3 * var)
            one = self.knobs.one
            state.shared += min(1.0, seconds / self.knobs.memory_s) * (max(-one, min(one, shared)) - state.shared)
        state.before = a, b, c

    def broken(self) -> None:
        """The next innovation has no neighbour."""
        self.state.before = None
