"""The bias's random walks from measurements to now, for evidence that is taken late.

A reading of then is one of now less the walk w since, and less what warmth has moved the bias by, which is the slope's to tell.
But the error e of what is believed now has w in it, too: E[e wᵀ] is followed through all that happens to the filter meanwhile (a
stochastic clone of the bias; S. Roumeliotis, J. Burdick, ICRA 2002), so that a reading is worth as much late as it was in time.
The bias is the first three of n states, its slope by temperature the next three.
"""

import numpy as np
from numpy.typing import NDArray

from estimator.state import StateStruct, shaped

Floats = NDArray[np.float64]
_BIAS, _SLOPE = slice(0, 3), slice(3, 6)


_VAR, _WITHIN, _WARMER = slice(0, 3), slice(3, 6), 6


class Walks(StateStruct):
    """k walks, the earliest first: cross (k, n, 3) = E[e wᵀ]; own (k, 7): variance (3,) of w, within (3,), warmer, K, since then.

    within: what a walk that began earlier has in common with w beyond its variance, from the second in which this one began.
    """

    cross: Floats
    own: Floats

    @classmethod
    def none(cls, n: int) -> "Walks":
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
        cross = np.zeros(self.cross.shape[1:])
        cross.flat[:9:4] = walked / 2
        for K, H in taken:
            cross -= K @ (H @ cross)
        self.cross = np.concatenate([self.cross, cross[None]])
        self.own = np.concatenate([self.own, [[*(walked / 3).tolist(), *(walked / 6).tolist(), 0.0]]])

    def step(self, F: Floats, walked: Floats) -> None:
        """The state went on by F (n, n), its bias with a walk of variance (3,)."""
        self.cross = F @ self.cross
        self.cross.reshape(len(self), -1)[:, :9:4] += walked
        self.own[:, _VAR] += walked
        self.own[:, _WARMER] += F[0, 3]

    def taken(self, K: Floats, H: Floats) -> None:
        """The state took something in with gain K (n, m) by H (m, n)."""
        self.cross -= K @ (H @ self.cross)

    def first_taken(self, K: Floats, H: Floats) -> None:
        """What was measured at the first of the walks was taken in with gain K by H, as `sight` gives it."""
        self.cross, self.own = self.cross[1:], self.own[1:]
        if len(self):
            # Of two walks to now the later is a part of the earlier, and its first step, of which it has a mean, all of it is.
            common = self.own[:, _VAR] + self.own[:, _WITHIN]
            self.cross = self.cross - K @ (H @ self.cross - H[:, _BIAS] * common[:, None])

    def sight(self, H: Floats) -> tuple[Floats, Floats, Floats]:
        """What a measurement at the first of them by H (m, n) sees of the state as it is now, (m, n).

        And what the walk adds to its noise, (m, m), and the covariance of that with the error of the state, (n, m).
        """
        now, along = H.copy(), H[:, _BIAS]
        now[:, _SLOPE] -= self.own[0, _WARMER] * along
        return now, (along * self.own[0, _VAR]) @ along.T, -self.cross[0] @ along.T
