"""How a device is treated, all of it."""

from dataclasses import dataclass, field
from math import inf

from estimator.calibration.bias_wander import WanderKnobs
from estimator.calibration.method_names import DEFAULT
from estimator.geometry.gyro_model import PriorKnobs
from estimator.stillness.detector import StillnessKnobs
from estimator.tracking.tracker import TrackKnobs


@dataclass(frozen=True, slots=True)
class SessionKnobs:
    """Seconds of device time."""

    method: str = DEFAULT
    #: after power-up, before anything is believed
    warming_s: float = 1.0
    #: rad/s, full scale of a reading; infinite: not known
    gyro_range: float = inf
    #: whether only turns about a horizontal axis count, where there is an accelerometer: gravity checks their angle
    horizontal_turns: bool = False
    #: farther from 1, and from the other axes', no scale factor of such a device is (relative): the turn was no full one
    scale_limit: float = inf
    prior: PriorKnobs = field(default_factory=PriorKnobs)
    #: how the bias wanders on a turntable or a servo
    wander: WanderKnobs = field(default_factory=WanderKnobs)
    stillness: StillnessKnobs = field(default_factory=StillnessKnobs)
    track: TrackKnobs = field(default_factory=TrackKnobs)
