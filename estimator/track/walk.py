"""The bias's random walk w from a measurement to now, for evidence that is taken late.

A reading of then is one of now less w, and less what warmth has moved the bias by, which is the slope's to tell. But the error e
of what is believed now has w in it, too: cross = E[e wᵀ] is followed through all that happens to the filter meanwhile (a
stochastic clone of the bias; S. Roumeliotis, J. Burdick, ICRA 2002), so that a reading is worth as much late as it was in time.
The bias is the first three of n states, its slope by temperature the next three.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_BIAS, _SLOPE = slice(0, 3), slice(3, 6)


@dataclass(slots=True, eq=False)
class Walk:
    """cross (n, 3) = E[e wᵀ]; var (3,) of w; warmer, K, since then.

    within (3,): what a walk that began earlier has in common with w beyond var, from the second in which this one began.
    """

    cross: Floats
    var: Floats
    within: Floats
    warmer: float = 0.0

    @classmethod
    def begun(cls, n: int, walked: Floats) -> "Walk":
        """Of n states, of a measurement spread over a step that walked by a variance (3,): its mean is half a step old.

        To be made as the step ends, before anything of it is taken in.
        """
        cross = np.zeros((n, 3))
        np.fill_diagonal(cross, walked / 2)
        return cls(cross, walked / 3, walked / 6)

    def step(self, F: Floats, walked: Floats) -> None:
        """The state went on by F (n, n), its bias with a walk of variance (3,)."""
        self.cross = F @ self.cross
        self.cross.flat[:9:4] += walked
        self.var = self.var + walked
        self.warmer += F.item(0, 3)

    def taken(self, K: Floats, H: Floats, late: "Walk | None" = None) -> None:
        """The state took something in with gain K (n, m) by H (m, n): of now, or of a walk ago."""
        seen = H @ self.cross
        if late is not None:
            # Of two walks to now the shorter is a part of the longer, and its first step, of which it has a mean, all of it is.
            shorter = self if self.var[0] < late.var[0] else late
            seen = seen - H[:, _BIAS] * (shorter.var + shorter.within)
        self.cross = self.cross - K @ seen

    def sight(self, H: Floats) -> tuple[Floats, Floats, Floats]:
        """What a measurement of then by H (m, n) sees of the state as it is now, (m, n).

        And what the walk adds to its noise, (m, m), and the covariance of that with the error of the state, (n, m).
        """
        now, along = H.copy(), H[:, _BIAS]
        now[:, _SLOPE] -= self.warmer * along
        return now, (along * self.var) @ along.T, -self.cross @ along.T
