"""Settings of a device session: method, limits, and settings of its parts."""

from dataclasses import dataclass, field
from math import inf

from estimator.calibration.bias_wander import WanderKnobs
from estimator.calibration.method_names import DEFAULT
from estimator.geometry.gyro_model import PriorKnobs
from estimator.tracking.track_knobs import TrackKnobs


@dataclass(frozen=True, slots=True)
class SessionKnobs:
    """Settings of a device session; times in seconds of device time.

    method: calibration method. warming_s: time after power-up before any reading is used, s.
    gyro_range: full-scale range, rad/s; infinite when unknown. horizontal_turns: accept only turns about a horizontal
    axis, if there is an accelerometer.
    scale_limit: largest relative deviation of a scale factor that is accepted. prior, wander, track: settings of the
    prior, of bias wander during calibration, and of the bias tracker.
    """

    method: str = DEFAULT
    #: s after power-up before any reading is used
    warming_s: float = 1.0
    #: rad/s, full-scale range; infinite when unknown
    gyro_range: float = inf
    #: accept only turns about a horizontal axis where there is an accelerometer: gravity checks their angle
    horizontal_turns: bool = False
    #: relative; a scale factor farther from 1, or from the other axes', means that a turn was not a full one
    scale_limit: float = inf
    prior: PriorKnobs = field(default_factory=PriorKnobs)
    #: bias wander during calibration on a turntable or a servo
    wander: WanderKnobs = field(default_factory=WanderKnobs)
    track: TrackKnobs = field(default_factory=TrackKnobs)
