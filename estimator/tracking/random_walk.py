"""Random walk of the bias from a measurement to the present, for delayed evidence.

A delayed reading measures the present bias less the walk w since then, and less the change by temperature, which the slope
tells. The error e of the present state contains w, too. So E[e wᵀ] is tracked through all steps and updates of the filter (a
stochastic clone of the bias; S. Roumeliotis, J. Burdick, ICRA 2002); a delayed reading is then worth as much as a prompt one.
The bias is the first three of n states, its slope by temperature the next three.
"""

import numpy as np
from numpy.typing import NDArray

from estimator.kernels import random_walk as loop
from estimator.state import StateStruct, shaped

Floats = NDArray[np.float64]


class RandomWalks(StateStruct):
    """Random walks of the bias behind k waiting measurements, the earliest first.

    cross (k, n, 3): E[e wᵀ]. own (k, 7): variance (3,) of w, within (3,), and warming since then, K.
    within: what an earlier walk has in common with w beyond its variance, from the second in which this walk began.
    """

    cross: Floats
    own: Floats

    @classmethod
    def none(cls, n: int) -> "RandomWalks":
        """No walks, for a filter of n states."""
        return cls(np.zeros((0, n, 3)), np.zeros((0, 7)))

    def check(self, n: int) -> None:
        """Check the shapes for n states. Raises ValueError."""
        shaped(self.own, -1, 7, finite=True)
        shaped(self.cross, len(self), n, 3, finite=True)

    def __len__(self) -> int:
        return len(self.own)

    def begin(self, walked: Floats, taken: list[tuple[Floats, Floats]]) -> None:
        """Begin a walk for a measurement averaged over the last step, whose walk has variance (3,): it is half a step old.

        taken: gain and H of the updates since the step.
        """
        self.cross, self.own = loop.begun(self.cross, self.own, walked)
        for K, H in taken:
            loop.taken(self.cross[-1:], self.own[-1:], K, H, 0.0)

    def step(self, F: Floats, walked: Floats) -> None:
        """Follow a prediction by F (n, n) with a walk of variance (3,)."""
        loop.stepped(self.cross, self.own, F, walked)

    def taken(self, K: Floats, H: Floats) -> None:
        """Follow an update with gain K (n, m) by H (m, n)."""
        loop.taken(self.cross, self.own, K, H, 0.0)

    def first_taken(self, K: Floats, H: Floats) -> None:
        """Follow the update with the earliest waiting measurement: gain K, and H from `sight`; its walk ends."""
        self.cross, self.own = self.cross[1:], self.own[1:]
        loop.taken(self.cross, self.own, K, H, 1.0)

    def sight(self, H: Floats) -> tuple[Floats, Floats, Floats]:
        """Observation of the present state by the earliest waiting measurement, whose own is H (m, n).

        Returns H (m, n) for the present state, the walk's addition to the noise (m, m), and the covariance (n, m) of the
        state's error with that noise.
        """
        return loop.sight(H, self.cross[0], self.own[0])
