"""Settings of the bias tracker."""

from dataclasses import dataclass, field

import numpy as np

from estimator.tracking.bias_state import BiasKnobs
from estimator.tracking.gravity import GravityKnobs


@dataclass(frozen=True, slots=True)
class TrackKnobs:
    """Settings of the bias tracker, with those of its bias filter (`bias`) and gravity evidence (`gravity`).

    bias_std: standard deviation of the bias, rad/s, above which the bias counts as unknown.
    usual_bias: standard deviation of the turn-on bias of most gyros, rad/s.
    refuted_sigmas: difference between the slope by temperature and the temperature law, in standard deviations, at
        which the law is given up.
    quiet_gyro, quiet_accel: standard deviations of the readings, rad/s and m/s², below which a device is quiet.
    gap_s, settled_s: a gap in the evidence of at least gap_s seconds is smoothed, after evidence for settled_s seconds.
    history: number of seconds stored for smoothing; None stores all.
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
