"""The bias's random walk from a measurement to now, for evidence that is taken late.

A reading of then is one of now less the walk w since, and less what warmth has moved the bias by, which is the slope's to tell.
But the error e of what is believed now has w in it, too: E[e wᵀ] is followed through all that happens to the filter meanwhile (a
stochastic clone of the bias; S. Roumeliotis, J. Burdick, ICRA 2002), so that a reading is worth as much late as it was in time.
The bias is the first three of n states, its slope by temperature the next three.
"""

import numpy as np
from numpy.typing import NDArray

from estimator.kernels import random_walk as loop
from estimator.state import StateStruct, shaped

Floats = NDArray[np.float64]


class RandomWalks(StateStruct):
    """k walks, the earliest first: cross (k, n, 3) = E[e wᵀ]; own (k, 7): variance (3,) of w, within (3,), warmer, K, since then.

    within: what a walk that began earlier has in common with w beyond its variance, from the second in which this one began.
    """

    cross: Floats
    own: Floats

    @classmethod
    def none(cls, n: int) -> "RandomWalks":
        """Of n states."""
        return cls(np.zeros((0, n, 3)), np.zeros((0, 7)))

    def check(self, n: int) -> None:
        """Raises ValueError where it is not of n states."""
        shaped(self.own, -1, 7, finite=True)
        shaped(self.cross, len(self), n, 3, finite=True)

    def __len__(self) -> int:
        return len(self.own)

    def begin(self, walked: Floats, taken: list[tuple[Floats, Floats]]) -> None:
        """Of a measurement spread over a step that walked by a variance (3,): its mean is half a step old.

        taken: gain and H of what was taken in since the step ended.
        """
        self.cross, self.own = loop.begun(self.cross, self.own, walked)
        for K, H in taken:
            loop.taken(self.cross[-1:], self.own[-1:], K, H, 0.0)

    def step(self, F: Floats, walked: Floats) -> None:
        """The state went on by F (n, n), its bias with a walk of variance (3,)."""
        loop.stepped(self.cross, self.own, F, walked)

    def taken(self, K: Floats, H: Floats) -> None:
        """The state took something in with gain K (n, m) by H (m, n)."""
        loop.taken(self.cross, self.own, K, H, 0.0)

    def first_taken(self, K: Floats, H: Floats) -> None:
        """What was measured at the first of the walks was taken in with gain K by H, as `sight` gives it."""
        self.cross, self.own = self.cross[1:], self.own[1:]
        loop.taken(self.cross, self.own, K, H, 1.0)

    def sight(self, H: Floats) -> tuple[Floats, Floats, Floats]:
        """What a measurement at the first of them by H (m, n) sees of the state as it is now, (m, n).

        And what the walk adds to its noise, (m, m), and the covariance of that with the error of the state, (n, m).
        """
        return loop.sight(H, self.cross[0], self.own[0])
