"""Evidence that is taken late: the bias has walked on since it was measured.

A reading of then is one of now less that walk w, and less what warmth has moved the bias by, which is the slope's to tell. But
the error of what is believed now has w in it, too: cross follows E[e wᵀ] through all that happens to the filter meanwhile (a
stochastic clone of the bias; S. Roumeliotis, J. Burdick, ICRA 2002), so that a reading is worth as much late as it was in time,
and no more.
"""

import numpy as np
from numpy.typing import NDArray

from estimator.loops.late import begun, knew_more, sight, went_on

Floats = NDArray[np.float64]

#: the rows of what is measured now
NOW = np.empty((0, 3))


class Since:
    """The walk from a measurement to now, in rows (n + 5, 3) of loops/late.py."""

    def __init__(self, n: int, walked: Floats) -> None:
        """Walked (3, 3), diagonal: variance of the walk while it was measured; its mean is half a step older than the step's end.

        To be made as the step ends, before anything of it is taken in.
        """
        self.rows = begun(n, walked)

    @property
    def cross(self) -> Floats:
        """(n, 3) covariance of the error of the state with the walk; to be written to."""
        return self.rows[:-5]

    def sight(self, H: Floats) -> tuple[Floats, Floats, Floats]:
        """What a measurement of then by H (m, n) sees of the state as it is now, (m, n).

        And what the walk adds to its noise, (m, m), and the covariance of that with the error of the state, (n, m).
        """
        n = H.shape[1]
        rows = sight(self.rows, H)
        return rows[:, :n], rows[:, 2 * n :], rows[:, n : 2 * n].T

    def step(self, F: Floats, Q: Floats) -> None:
        """The state went on by F, with Q (n, n) added."""
        went_on(self.rows, F, Q)

    def taken(self, K: Floats, H: Floats, late: "Since | None") -> None:
        """The state took something in with gain K (n, m) by H (m, n): something of now, or late itself."""
        knew_more(self.rows, K, H, NOW if late is None else late.rows)
