"""How far a gyro's axes may be misaligned, as the turns of a session show it.

An element E_ij of the matrix K (I + E) reads a turn about axis j as one that tilts towards i by E_ij, as a hand's own tilt
does: turns alone cannot tell one from the other. A scale factor fitted without E is off by E times the tilt that is read. Tilts
of the size that hands make are put down to the hand; what is beyond is put down to E.
"""

from collections.abc import Sequence
from math import degrees, sqrt

import numpy as np
from numpy.typing import NDArray

from bridge.reasons.codes import Code, Sentences
from estimator.calibration.capture import TurnCapture
from estimator.geometry.gyro_model import SIGMAS

Floats = NDArray[np.float64]
#: rms tilt of a turn's axis that a hand makes, relative to 1 rad
HAND = 0.03
#: the least standard deviation of an element
LEAST = 0.0015
#: from which on a result says so
_WORTH_SAYING = 0.01


def estimate(rate: Floats, dt: Floats, k: Floats, turns: Sequence[TurnCapture]) -> float:
    """Standard deviation of each element of E; rate (3, n, 3) rad/s without bias, dt (3, n) s, k (3,), of three turns."""
    turned = k * np.einsum("itj,it->ij", rate, dt)
    axes = [turn.axis for turn in turns]
    tilt = turned / np.abs(turned[range(3), axes])[:, None]
    tilt[range(3), axes] = 0.0
    return sqrt(LEAST**2 + max(0.0, float(np.sum(tilt**2)) / 6 - HAND**2))


def said(std: float, scale_std: float) -> Sentences:
    """What to add to a result whose scale, of relative standard deviation scale_std, is unsure because its turns were tilted."""
    if std < _WORTH_SAYING:
        return ()
    tilt, sure = degrees(sqrt(std**2 - LEAST**2 + HAND**2)), 100 * SIGMAS * scale_std
    return (Code.TURNS_TILTED(percent=f"{sure:.1f}", angle_deg=f"{tilt:.0f}"),)
