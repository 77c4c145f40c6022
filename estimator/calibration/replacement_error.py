"""Re-placement error: attitude difference between start and end of a turn when a hand puts the device back.

It is estimated from the session. Three turns give nine closure errors, three of which the scale factors absorb. An
accelerometer measures the tilts too. The estimate is the variance s², rad² per axis, that solves

    sum of x' (V + s² I)^-1 x = degrees of freedom - 2

Here x (rad) are the errors. V (rad²) is the part of their covariance from all other errors.
The subtraction of 2 follows Student's t, whose variance is dof / (dof - 2) times that of a normal distribution. The
covariance of the calibration then has the true spread.
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

    std: difference between start and end of a turn by hand.
    tilt_std: error of a measured tilt.
    With an accelerometer, `std` applies only about the vertical, and `tilt_std` about horizontal axes.
    """

    std: float
    tilt_std: float = 0.0


#: initial values: a table's edge allows a quarter of a millimetre over 5 cm; and the tilt error of an accelerometer
USUAL = Replacement(radians(0.2), radians(0.1))


@dataclass(frozen=True, slots=True, eq=False)
class End:
    """End attitude (3, 3) of a turn in the frame of its start; the identity where no accelerometer measured a tilt.

    up (3,): unit vector of the vertical in that frame, or None without an accelerometer.
    tilt (3,): measured tilt as a rotation vector, rad.
    tilt_var: variance of the measured tilt from accelerometer noise and errors, rad² per axis, without the re-placement
        error.
    """

    attitude: Floats
    up: Floats | None = None
    tilt: Floats = field(default_factory=lambda: np.zeros(3))
    tilt_var: float = 0.0

    def covariance(self, of: Replacement) -> Floats:
        """Covariance (3, 3), rad², of the end attitude's error, in the frame of the turn's start.

        of: standard deviations of the re-placement error, rad per axis.
        """
        if self.up is None:
            return of.std**2 * np.eye(3)
        across = self.tilt_var + of.tilt_std**2
        return across * np.eye(3) + (of.std**2 - across) * np.outer(self.up, self.up)


def estimate(ends: Sequence[End], residual: Floats, known: Floats) -> Replacement:
    """Estimate the re-placement error (rad per axis) from the closure residuals of three turns.

    ends: measured end attitudes.
    residual (3, 3): closure errors as rotation vectors, rad, one row per turn.
    known (3, 3, 3): covariance of each residual without the re-placement error, rad².
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
