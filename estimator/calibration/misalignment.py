"""Size of a gyro's axis misalignment, estimated from the turns of a session.

The gyro matrix is K (I + E), with scale factors K and misalignment E, relative (rad). An element E_ij makes a turn
about axis j read as tilted towards axis i by E_ij.
A turn that the hand tilts reads the same, so turns alone cannot separate the two. A scale factor fitted without E is
wrong by E times the tilt that is read.
The estimate attributes tilts up to 0.03 rad, typical for hands, to the hand. It attributes the excess to E.
"""

from collections.abc import Sequence
from math import degrees, sqrt

import numpy as np

from bridge.reasons.codes import Code, Sentences
from estimator.calibration.capture import TurnCapture
from estimator.geometry.gyro_model import SIGMAS, Floats

#: rms tilt of a turn's axis by hand, rad
HAND = 0.03
#: least standard deviation of an element of E
LEAST = 0.0015
#: standard deviation from which the result mentions tilted turns
_WORTH_SAYING = 0.01


def estimate(rate: Floats, dt: Floats, k: Floats, turns: Sequence[TurnCapture]) -> float:
    """Standard deviation of each off-diagonal element E_ij of the misalignment (relative, rad), from three turns.

    rate (3, n, 3): readings less the bias, rad/s. dt (3, n): sample intervals, s.
    k (3,): scale factors. turns: give the axis of each turn.
    """
    turned = k * np.einsum("itj,it->ij", rate, dt)
    axes = [turn.axis for turn in turns]
    tilt = turned / np.abs(turned[range(3), axes])[:, None]
    tilt[range(3), axes] = 0.0
    return sqrt(LEAST**2 + max(0.0, float(np.sum(tilt**2)) / 6 - HAND**2))


def said(std: float, scale_std: float) -> Sentences:
    """Reason text that a result is uncertain because its turns were tilted; empty for a small misalignment.

    std: misalignment, relative (rad), result of `estimate`; small means below 0.01.
    scale_std: relative standard deviation of the scale factors.
    """
    if std < _WORTH_SAYING:
        return ()
    tilt, sure = degrees(sqrt(std**2 - LEAST**2 + HAND**2)), 100 * SIGMAS * scale_std
    return (Code.TURNS_TILTED(percent=f"{sure:.1f}", angle_deg=f"{tilt:.0f}"),)
