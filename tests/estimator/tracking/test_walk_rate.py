"""A bias that walks faster or slower than the model says: the tracker learns it from rests and is as sure as it may be."""

from dataclasses import replace

import numpy as np
import pytest

from bridge.recording import Recording
from estimator.config.device_settings import knobs_of
from estimator.noise.device_model import load_model
from estimator.offline.recordings import correct
from tests.sim.scenes import rests_and_motion

KNOBS = knobs_of(load_model("icm-20948"))
WALK_DPS = float(np.degrees(KNOBS.track.bias.rate_random_walk))


@pytest.mark.parametrize("times", [1.0, 4.0])
def test_deviations_fit_the_walk_of_the_boot(times: float) -> None:
    """NEES per axis in the second half of ten minutes; with the walk of the model alone the second is 9."""
    nees = []
    for seed in range(4):
        day = rests_and_motion(seed, 600.0, 50.0, rrw_dps_per_sqrt_s=times * WALK_DPS)
        arrays = Recording.from_arrays(day.gyro.astype(float), day.accel.astype(float), rate_hz=day.rate_hz)
        warm = replace(arrays, temperature_c=np.full(len(day.gyro), 30.0))  # it does not warm up
        c = correct(warm, knobs=KNOBS)
        half = slice(len(c) // 2, None)
        nees.append(np.mean(((c.bias[half] - day.bias[half]) / c.bias_std[half]) ** 2))
    assert 0.3 < np.mean(nees) < 2.0
