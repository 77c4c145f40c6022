"""Smoothing of attitudes: later samples improve the levelling of earlier ones (Rauch, Tung and Striebel)."""

import numpy as np

from estimator.geometry.gyro_model import Floats
from estimator.kernels import orientation as loop
from estimator.orientation.attitude import G, Oriented


def smooth(real_time: Oriented, trace: Floats, accel_std: Floats) -> Oriented:
    """Smooth attitudes: improve the tilt of n real-time attitudes by later samples; the heading does not change.

    real_time, trace (n, 11): both from `Attitude.traced`.
    accel_std (3,): standard deviation of the accelerometer bias, m/s².
    Smoothing reduces the part of the tilt variance that comes from noise. The part from the accelerometer bias stays.
    Source: H. E. Rauch, F. Tung, C. T. Striebel, "Maximum likelihood estimates of linear dynamic systems", AIAA Journal
    3 (1965).
    """
    quaternions, share = real_time.quat_wxyz.copy(order="C"), np.empty(len(trace))
    loop.smoothed(trace, quaternions, share)
    cov, stays = real_time.cov.copy(), float(np.mean(accel_std**2)) / G**2
    for variance in (0, 3):
        cov[:, variance] = share * cov[:, variance] + (1 - share) * np.minimum(stays, cov[:, variance])
    cov[:, 1] *= share
    cov[:, [2, 4]] *= np.sqrt(share)[:, None]
    return real_time._replace(quat_wxyz=quaternions, cov=cov)
