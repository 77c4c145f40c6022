"""Plausibility check of a calibration that a device made itself. Pure.

The device uses Algorithm 1 of Wang et al. 2024; its code is in `embedded/`.
"""

from math import degrees, radians

import numpy as np
from numpy.typing import NDArray

from bridge.reasons.codes import Code, Sentences
from bridge.wire.messages import DeviceCalibration, Verdict
from estimator.calibration.result import Result, unbelievable

Floats = NDArray[np.float64]
#: method name of such a calibration
METHOD = "device"
#: Standard deviations of its scale factors and of its bias, rad/s: the device states none. They hold for hands that put
#: the device back within 1 degree and wobble by 5, and for rests of 3 s; tests/embedded measures both.
SCALE_STD, BIAS_STD = 3e-3, radians(0.02)
#: rad/s; no gyroscope in use reads more at rest
MOST_BIAS = radians(30.0)
#: rad/s; how far the bias may have wandered since, beside what both estimates do not know
WANDER_STD = radians(0.2)
_SIGMAS = 5.0


def judged(own: DeviceCalibration, boot: int, seen: tuple[Floats, Floats] | None, noise_std: Floats) -> Result:
    """Return a device's own calibration with a verdict: ACCEPTED, or REFUSED when it is not plausible.

    own: scale factors, bias (rad/s) and boot of the device's calibration. boot: the device's present boot id.
    seen: bias (3,) measured in rests of this boot, and its standard deviation (3,), both rad/s; None before a rest.
    noise_std (3,): white noise of a reading, rad/s.

    Checked are the boot, the range of scale factors and bias, and the difference from the bias in `seen`.
    """
    scale, bias = np.array(own.scale), np.array(own.bias)
    reason = _refused(own, boot, seen)
    verdict, reason = (Verdict.REFUSED, reason) if reason else (Verdict.ACCEPTED, (Code.OWN_ACCEPTED(),))
    covariance = np.diag([BIAS_STD**2] * 3 + [SCALE_STD**2] * 3)
    return Result(METHOD, verdict, reason, np.diag(scale), bias, covariance, noise_std)


def _refused(own: DeviceCalibration, boot: int, seen: tuple[Floats, Floats] | None) -> Sentences:
    if own.boot != boot:
        return (Code.OWN_OF_ANOTHER_BOOT(),)
    if (outside := unbelievable(np.array(own.scale))) is not None:
        return outside[1]
    bias = np.array(own.bias)
    if np.abs(bias).max() > MOST_BIAS:
        return (Code.OWN_BIAS_LARGE(bias_dps=_dps(bias), most_dps=f"{degrees(MOST_BIAS):.0f}"),)
    if seen is not None:
        limit = _SIGMAS * np.sqrt(seen[1] ** 2 + BIAS_STD**2 + WANDER_STD**2)
        if np.any(np.abs(bias - seen[0]) > limit):
            return (Code.OWN_BIAS_CONTRADICTED(own_dps=_dps(bias), seen_dps=_dps(seen[0])),)
    return ()


def _dps(bias: Floats) -> str:
    return ", ".join(f"{value:.2f}" for value in np.degrees(bias))
