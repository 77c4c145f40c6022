"""Prior of a device that boots: earlier calibration and temperature law, and how far they still hold."""

from dataclasses import dataclass, replace

import numpy as np

from bridge.wire.messages import Calibration
from estimator.tracking.bias_filter import BIAS, BiasFilter, BiasKnobs, BiasState, start
from estimator.tracking.temperature_law import TemperatureLaw

#: samples this much older than the last checkpoint are the bus's cache; older ones mean that the clock lost count
CACHE_S = 60.0


@dataclass(frozen=True, slots=True)
class PriorKnowledge:
    """Its last calibration, and, of this very boot, the bias since."""

    calibration: Calibration | None
    bias: BiasState | None
    #: host seconds since the bias was kept, and whether it was in doubt then
    age_s: float = 0.0
    doubted: bool = False
    #: who had asked for a recalibration that was under way then, and why
    asked: tuple[str, str] | None = None

    def under(self, calibration: Calibration) -> "PriorKnowledge":
        """The same where it is this one that holds: a bias that was doubted without it is to be told by a rest."""
        bias = None if self.doubted else self.bias
        return replace(self, calibration=calibration, bias=bias, doubted=False)

    def bias_at(self, now: float, doubt_std: float) -> BiasState | None:
        """The bias as it was kept; doubted by doubt_std, rad/s, where nobody knows how long ago: a rest has to confirm it."""
        if self.bias is None:
            return None
        return wider(replace(self.bias, time=now), doubt_std) if self.lost_count(now) else self.bias

    def lost_count(self, now: float) -> bool:
        """Whether nobody knows how long before the device time `now` the bias was kept."""
        if self.bias is None:
            return False
        passed = now - self.bias.time
        return passed < -CACHE_S or self.age_s - passed > CACHE_S


def calibrated_bias(
    calibration: Calibration, now: float, powered: float, knobs: BiasKnobs, law: TemperatureLaw | None = None
) -> BiasState:
    """The bias as it was calibrated, at device time `now` of a device switched on at `powered`; its slope as a law has it."""
    bias, cov = calibration.bias, calibration.covariance[:3, :3]
    begun = start(bias, cov, now, knobs, temperature_c=calibration.temperature_c, powered=powered)
    if law is None:
        return begun
    expecting = BiasFilter(begun, knobs)
    expecting.expect(law)
    return expecting.state


def wider(state: BiasState, doubt_std: float) -> BiasState:
    """The same, its bias doubted by so much more, rad/s."""
    P = state.P.copy()
    P[BIAS, BIAS] += doubt_std**2 * np.eye(3)
    return replace(state, P=P)
