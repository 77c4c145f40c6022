"""Size of a gyro's axis misalignment, estimated from the turns of a session.

An element E_ij of the matrix K (I + E) makes a turn about axis j read as tilted towards i by E_ij. The hand's own tilt
looks the same, so turns alone cannot tell the two apart. A scale factor fitted without E is off by E times the tilt
that is read.
Tilts of a size typical for hands are attributed to the hand, the excess to E.
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

    rate (3, n, 3) rad/s: readings less the bias. dt (3, n) s. k (3,): scale factors. turns: give the axis of each turn.
    """
    turned = k * np.einsum("itj,it->ij", rate, dt)
    axes = [turn.axis for turn in turns]
    tilt = turned / np.abs(turned[range(3), axes])[:, None]
    tilt[range(3), axes] = 0.0
    return sqrt(LEAST**2 + max(0.0, float(np.sum(tilt**2)) / 6 - HAND**2))


def said(std: float, scale_std: float) -> Sentences:
    """Explain that a result is uncertain because its turns were tilted, as sentences; () for a small `std`.

    std: result of `estimate`. scale_std: relative standard deviation of the scale factors.
    """
    if std < _WORTH_SAYING:
        return ()
    tilt, sure = degrees(sqrt(std**2 - LEAST**2 + HAND**2)), 100 * SIGMAS * scale_std
    return (Code.TURNS_TILTED(percent=f"{sure:.1f}", angle_deg=f"{tilt:.0f}"),)
