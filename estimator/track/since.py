"""Evidence that is taken late: the bias has walked on since it was measured.

A reading of then is one of now less that walk w, and less what warmth has moved the bias by, which is the slope's to tell. But
the error of what is believed now has w in it, too: cross follows E[e wᵀ] through all that happens to the filter meanwhile (a
stochastic clone of the bias; S. Roumeliotis, J. Burdick, ICRA 2002), so that a reading is worth as much late as it was in time,
and no more.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_BIAS, _SLOPE = slice(0, 3), slice(3, 6)


class Since:
    """The walk from a measurement to now: cross (n, 3), its covariance with the error of the state, and var (3, 3).

    warmer: K, from then to now.
    """

    def __init__(self, n: int, walked: Floats) -> None:
        """Walked (3, 3): variance of the walk while it was measured; its mean is half a step older than the step's end."""
        self.cross = np.zeros((n, 3))
        self.cross[_BIAS] = walked / 2
        self.var = walked / 3
        self.warmer = 0.0

    def seen(self, H: Floats) -> Floats:
        """(m, n) what a measurement of then by H (m, n) sees of the state as it is now."""
        if not self.warmer:
            return H
        seen = H.copy()
        seen[:, _SLOPE] -= self.warmer * H[:, _BIAS]
        return seen

    def noise(self, H: Floats) -> Floats:
        """(m, m) what the walk adds to the noise of a measurement by H (m, n)."""
        axes = H[:, _BIAS]
        return np.asarray(axes @ self.var @ axes.T)

    def shared(self, H: Floats) -> Floats:
        """(n, m) covariance of that noise with the error of the state."""
        return np.asarray(-self.cross @ H[:, _BIAS].T)

    def step(self, F: Floats, walked: Floats | None = None) -> None:
        """The state went on by F (n, n), and the bias walked by (3, 3)."""
        self.cross = F @ self.cross
        self.warmer += float(F[_BIAS, _SLOPE][0, 0])
        if walked is not None:
            self.cross[_BIAS] += walked
            self.var = self.var + walked

    def taken(self, K: Floats, H: Floats, late: "Since | None") -> None:
        """The state took something in with gain K (n, m) by H (m, n): something of now, or late itself."""
        self.cross = self.cross - K @ (H @ self.cross)
        if late is not None:
            # Of two walks to now the shorter is a part of the longer.
            shared = self.var if self.var[0, 0] < late.var[0, 0] else late.var
            self.cross += K @ H[:, _BIAS] @ shared
