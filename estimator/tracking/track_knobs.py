"""Settings of the bias tracker."""

from dataclasses import dataclass, field

import numpy as np

from estimator.tracking.bias_state import BiasKnobs
from estimator.tracking.gravity import GravityKnobs


@dataclass(frozen=True, slots=True)
class TrackKnobs:
    """Settings of the bias tracker: times in device seconds, rates in rad/s, accelerations in m/s².

    learn_matrix: True to use the gyro matrix that the gravity evidence estimates while the device is worn.
    """

    #: rad/s; a bias with a greater standard deviation counts as unknown
    bias_std: float = np.radians(0.2)
    #: rad/s, standard deviation of the turn-on bias of most gyros, whatever the worst of their kind have
    usual_bias: float = np.radians(0.5)
    #: standard deviations between the slope by temperature and the law at which the law is given up
    refuted_sigmas: float = 4.0
    #: rad/s and m/s²; a device whose readings vary less is quiet, for example on a sleeping wearer
    quiet_gyro: float = np.radians(5.0)
    quiet_accel: float = 1.0
    #: s; after a gap in the evidence this long the past is smoothed, once evidence has come for settled_s
    gap_s: float = 10.0
    settled_s: float = 5.0
    #: number of seconds kept for smoothing; None keeps all
    history: int | None = 256
    bias: BiasKnobs = field(default_factory=BiasKnobs)
    gravity: GravityKnobs = field(default_factory=GravityKnobs)
    #: whether the matrix that gravity teaches while the device is worn becomes part of the correction
    learn_matrix: bool = False
