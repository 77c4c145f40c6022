"""Re-placement error: how accurately a hand puts a device back after a turn, estimated from the session.

Three turns give nine closure errors, three of which the scale factors absorb. An accelerometer measures the tilts too.
Each estimate is the variance s² per axis for which the sum of squares x' (V + s² I)^-1 x equals its degrees of freedom
less two, where V is the known part of the covariance. Less two, because deviations of few degrees of freedom follow
Student's t: its variance is dof / (dof - 2) times that of a normal distribution. The covariance of the calibration then
has the true spread.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import radians

import numpy as np
import scipy
from numpy.typing import NDArray

Floats = NDArray[np.float64]
#: rad, upper end of the search for an error
_LARGEST = 10.0


@dataclass(frozen=True, slots=True)
class Replacement:
    """Re-placement error as standard deviations, rad per axis.

    std: between start and end of a turn by hand. tilt_std: of a measured tilt.
    With an accelerometer `std` applies only about the vertical, and tilt_std across it.
    """

    std: float
    tilt_std: float = 0.0


#: initial values: a table's edge allows a quarter of a millimetre over 5 cm; and the tilt error of an accelerometer
USUAL = Replacement(radians(0.2), radians(0.1))


@dataclass(frozen=True, slots=True, eq=False)
class End:
    """End of a turn in the frame of its start: attitude (3, 3), the identity where no accelerometer measured a tilt.

    up (3,): the vertical in that frame, or None. tilt (3,) rad, as measured; tilt_var: the known part of its variance.
    """

    attitude: Floats
    up: Floats | None = None
    tilt: Floats = field(default_factory=lambda: np.zeros(3))
    tilt_var: float = 0.0

    def covariance(self, of: Replacement) -> Floats:
        """Covariance (3, 3), rad², of the end attitude's error, in the frame of the turn's start.

        of: size of the re-placement error.
        """
        if self.up is None:
            return of.std**2 * np.eye(3)
        across = self.tilt_var + of.tilt_std**2
        return across * np.eye(3) + (of.std**2 - across) * np.outer(self.up, self.up)


def estimate(ends: Sequence[End], residual: Floats, known: Floats) -> Replacement:
    """Estimate the re-placement error from the residuals (3, 3) of three turns, rad.

    known (3, 3, 3): covariance of the residuals without the re-placement error.
    """
    ups = [end.up for end in ends]
    if any(up is None for up in ups):
        return Replacement(_std([(r, V) for r, V in zip(residual, known, strict=True)], dof=6))
    up = np.array(ups)
    # The scale factor absorbs the heading of a turn about the vertical, and one tilt of any other turn.
    vertical = float(sum(up[axis, axis] ** 2 for axis in range(3)))
    planes = [scipy.linalg.null_space(u[None]).T for u in up]
    tilts = [
        (B @ r, B @ V @ B.T + end.tilt_var * np.eye(2))
        for B, r, V, end in zip(planes, residual, known, ends, strict=True)
    ]
    headings = [(np.array([u @ r]), np.array([[u @ V @ u]])) for u, r, V in zip(up, residual, known, strict=True)]
    measured = [(B @ end.tilt, end.tilt_var * np.eye(2)) for B, end in zip(planes, ends, strict=True)]
    # A hand's heading error is as large as its tilt error or larger, since a table's top is flat. Where all turns were
    # about the vertical, no closure error shows it.
    shown = 3 - vertical
    heading_std = _std(headings, dof=shown + 2) if shown > 1 else USUAL.std
    return Replacement(max(_std([*headings, *measured], dof=shown + 6), heading_std), _std(tilts, dof=3 + vertical))


def _std(errors: Sequence[tuple[Floats, Floats]], dof: float) -> float:
    """The s >= 0 for which the sum of x' (V + s² I)^-1 x is dof - 2; errors: pairs of x and its known covariance V."""

    def excess(s: float) -> float:
        return sum(float(x @ np.linalg.solve(V + s**2 * np.eye(len(x)), x)) for x, V in errors) - (dof - 2)

    return 0.0 if excess(0.0) <= 0 else float(scipy.optimize.brentq(excess, 0.0, _LARGEST, xtol=1e-7))
