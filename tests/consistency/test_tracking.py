"""Is the tracker as sure of the bias as it may be? NEES of whole trackers over simulated rests and movement, seeds fixed.

The scene is just what the filter assumes: a bias that is a pure random walk, white noise, true rests and free movement. The
tracker is told the walk and the matrix, and begins with an honest deviation.
"""

import numpy as np
from scipy.stats import chi2

from bridge.sim.scenes import rests_and_motion
from estimator.gyro import GyroModel
from estimator.stillness import Stillness
from estimator.track.bias_filter import BiasKnobs
from estimator.track.tracker import Tracker, TrackKnobs

SEEDS = 60
RATE_HZ, SECONDS = 50.0, 120.0
RRW_DPS = 2e-3
BEGIN_STD = np.radians(0.02)
BAND = chi2.ppf([0.025, 0.975], 3 * SEEDS) / (3 * SEEDS)


def nees(seed: int, *, accel: bool, told_rrw_dps: float) -> float:
    """NEES/dof of the bias at the end of one scene."""
    day = rests_and_motion(seed, SECONDS, RATE_HZ, rrw_dps_per_sqrt_s=RRW_DPS, noise_dps=0.05)
    gyro, force = day.gyro.astype(float), day.accel.astype(float) if accel else None
    begin = day.bias[0] + BEGIN_STD * np.random.default_rng(seed).normal(size=3)
    known = np.full(3, 1e-3)
    knobs = TrackKnobs(bias=BiasKnobs(rate_random_walk=np.radians(told_rrw_dps), warm_up_walk=0.0))
    tracker = Tracker(knobs, 0.0, GyroModel(day.truth.matrix, begin, known, known, known), np.full(3, BEGIN_STD))
    stillness = Stillness()
    for window in stillness.feed(day.time_s, gyro, force):
        tracker.window(window, stillness.noise_std)
    error = tracker.bias - day.bias[round(tracker.time * RATE_HZ) - 1]
    return float(error @ np.linalg.solve(tracker.state.bias_cov, error)) / 3


def mean_nees(seeds: int, *, accel: bool, told_rrw_dps: float = RRW_DPS) -> float:
    return float(np.mean([nees(seed, accel=accel, told_rrw_dps=told_rrw_dps) for seed in range(seeds)]))


def test_with_an_accelerometer_it_is_as_sure_as_it_may_be() -> None:
    """Inside the 95 % band. Over 200 seeds 1.01 was measured, the band 0.887 to 1.113."""
    low, high = BAND
    assert low < mean_nees(SEEDS, accel=True) < high


def test_without_one_it_is_a_little_too_sure() -> None:
    """A known limit: nothing but the gyro tells slow passages of a movement from a rest, and some pass for one.

    Over 200 seeds 1.11 was measured at the end of the scene, and 1.19 on average on the way there.
    """
    assert BAND[0] < mean_nees(SEEDS, accel=False) < 1.35


def test_told_a_walk_five_times_too_small_it_is_far_too_sure() -> None:
    """The tests above can fail."""
    assert mean_nees(20, accel=True, told_rrw_dps=RRW_DPS / 5) > 4.0
