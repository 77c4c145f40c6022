"""Motion of a device on a ward: put down, calibrated by hand, then worn without end by a wearer of wearer.py."""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from bridge.sim.body import Body
from bridge.sim.motion import Motion, Still, TrueMotion
from bridge.sim.motion_scripts import SessionPlan, flat, session
from bridge.sim.quaternion import Array
from bridge.sim.wearer import Wearer


class Life(Protocol):
    """Contract of a motion that is computed on demand, at rising times, such as Motion and Body."""

    def advance(self, time_s: Array) -> TrueMotion:
        """Return the true motion at times (n,), s since the start of the motion.

        Times must be rising, later than those of all calls before, and n ≥ 1. The first interval begins at 0.
        """


class Then:
    """Sequence of two motions: `first` until end_s, s since its start, then a second motion.

    `first` must be at rest at end_s. make: makes the second motion from an attitude (4,), quaternion wxyz, sensor to
    earth. That attitude is the one of the last sample of `first`.
    """

    def __init__(self, first: Life, end_s: float, make: Callable[[Array], Life]) -> None:
        self._now, self._make, self._end_s = first, make, end_s
        self._began_s = self._time_s = 0.0
        self._attitude: Array = np.array([1.0, 0.0, 0.0, 0.0])

    def advance(self, time_s: Array) -> TrueMotion:
        """Return the true motion at times (n,), s since the start of the first motion.

        Times must be rising, later than those of all calls before, and n ≥ 1.
        """
        upto = int(np.searchsorted(time_s, self._end_s, side="right"))
        parts = [self._lived(time_s[:upto])] if upto else []
        if upto < len(time_s):
            self._began_s, self._end_s = self._time_s, np.inf
            self._now = self._make(self._attitude)
            parts.append(self._lived(time_s[upto:]))
        names = ("time_s", "rate", "attitude", "force")
        return TrueMotion(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def _lived(self, time_s: Array) -> TrueMotion:
        lived = self._now.advance(time_s - self._began_s)
        self._time_s, self._attitude = float(time_s[-1]), lived.attitude[-1]
        return TrueMotion(time_s, lived.rate, lived.attitude, lived.force)


def ward_script(rng: np.random.Generator, rest_s: float = 2.0) -> Life:
    """Draw the motion of a device on a ward: at rest for rest_s, then calibrated within 30 s, then worn without end."""
    plan = SessionPlan(turn_s=(3.5, 5.0), wobble_deg=2.0, tilt_deg=3.0, replacement_deg=0.2)
    pieces = [Still(rest_s), *session(rng, plan)]
    first = Motion(pieces, flat(rng))
    lever = rng.uniform(-0.2, 0.2, 3)
    wearer = Wearer(rng)
    return Then(first, sum(piece.duration_s for piece in pieces), lambda at: Body(wearer.life(), lever, at))
