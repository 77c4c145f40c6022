"""A recording without temperature is honest about a bias that warms up meanwhile."""

import numpy as np
import pytest

from bridge.recording import Recording
from estimator.offline.recordings import correct
from tests.sim.day import Day, simulate_day


def recording(day: Day, *, temperature: bool, accel: bool) -> Recording:
    """A day's readings, with or without temperature and accelerometer."""
    return Recording(
        time_s=day.time_s - day.time_s[0],
        gyro=day.gyro.astype(float),
        accel=day.accel.astype(float) if accel else None,
        temperature_c=day.temperature_c.astype(float) if temperature else None,
        rate_hz=day.rate_hz,
        name="day",
    )


@pytest.mark.parametrize("accel", [True, False])
def test_the_truth_is_within_what_is_said_of_a_device_without_temperature(*, accel: bool) -> None:
    covered, std_dps = [], []
    for seed in (10, 11):
        day = simulate_day(seed, 0.25, 52.0)
        found = correct(recording(day, temperature=False, accel=accel))
        worn = day.time_s > 60.0
        error, std = (found.bias - day.bias)[worn].astype(float), found.bias_std[worn].astype(float)
        covered.append(np.mean(np.abs(error) < 1.96 * std))
        std_dps.append(np.degrees(np.sqrt(np.mean(std**2))))
    assert np.mean(covered) > 0.9, "of 95 % of all rows"
    assert np.mean(std_dps) < (0.02 if accel else 0.03), "who knows nothing is right, too"
