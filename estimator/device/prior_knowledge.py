"""Prior knowledge of a device at boot: stored calibration and bias, and how far they still hold."""

from dataclasses import dataclass, replace

import numpy as np

from bridge.wire.messages import Calibration
from estimator.tracking.bias_filter import BiasFilter
from estimator.tracking.bias_state import BIAS, BiasKnobs, BiasState, start
from estimator.tracking.temperature_law import TemperatureLaw

#: s; samples older than the checkpoint by less come from the bus's cache, older ones mean that the device clock lost count
CACHE_S = 60.0


@dataclass(frozen=True, slots=True)
class PriorKnowledge:
    """Stored calibration of a device, and the bias last stored in the present boot.

    bias: bias state in rad/s, or None. age_s: seconds since the bias was stored, by the host's clock.
    doubted: whether the bias was in doubt then. asked: the person who had requested a recalibration, and the reason.
    """

    calibration: Calibration | None
    bias: BiasState | None
    #: host seconds since the bias was stored, and whether it was doubted then
    age_s: float = 0.0
    doubted: bool = False
    #: who had asked for a recalibration in progress at that time, and why; else None
    asked: tuple[str, str] | None = None

    def under(self, calibration: Calibration) -> "PriorKnowledge":
        """Return a copy with another calibration; a bias that was in doubt is dropped."""
        bias = None if self.doubted else self.bias
        return replace(self, calibration=calibration, bias=bias, doubted=False)

    def bias_at(self, now: float, doubt_std: float) -> BiasState | None:
        """Return the stored bias for use at device time `now`, s; None if none is stored.

        If the age of the bias is unknown, the variance of each axis grows by the square of `doubt_std`, rad/s. A rest
        must then confirm the bias.
        """
        if self.bias is None:
            return None
        return wider(replace(self.bias, time=now), doubt_std) if self.lost_count(now) else self.bias

    def lost_count(self, now: float) -> bool:
        """Return whether device time disagrees with the host's clock on how long ago the bias was stored.

        The device's clock then stood still or was set back, and the age of the bias is unknown.

        now: present device time, s.
        """
        if self.bias is None:
            return False
        passed = now - self.bias.time
        return passed < -CACHE_S or self.age_s - passed > CACHE_S


def calibrated_bias(
    calibration: Calibration, now: float, powered: float, knobs: BiasKnobs, law: TemperatureLaw | None = None
) -> BiasState:
    """Compute the bias state that follows from a calibration, at device time `now`.

    now: device time, s. powered: device time of power-up, s. knobs: settings of the bias filter.
    law: temperature law that gives the slope of the bias; without a law the slope is zero with its prior variance.
    """
    bias, cov = calibration.bias, calibration.covariance[:3, :3]
    begun = start(bias, cov, now, knobs, temperature_c=calibration.temperature_c, powered=powered)
    if law is None:
        return begun
    expecting = BiasFilter(begun, knobs)
    expecting.expect(law)
    return expecting.state


def wider(state: BiasState, doubt_std: float) -> BiasState:
    """Return the bias state with a larger uncertainty.

    The variance of each axis grows by the square of `doubt_std`, rad/s.
    """
    P = state.P.copy()
    P[BIAS, BIAS] += doubt_std**2 * np.eye(3)
    return replace(state, P=P)
