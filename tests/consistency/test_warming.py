"""A recording without temperature is honest about a bias that warms up meanwhile; `tests/bench/warming.py` measures more."""

import numpy as np
import pytest

from bridge.sim.day import simulate_day
from tests.bench.warming import judged, recording


@pytest.mark.parametrize("accel", [True, False])
def test_the_truth_is_within_what_is_said_of_a_device_without_temperature(*, accel: bool) -> None:
    covered = []
    for seed in (10, 11):
        day = simulate_day(seed, 0.25, 52.0)
        covered.append(judged(day, recording(day, temperature=False, accel=accel))[0])
    assert np.mean(covered) > 90, "of 95 % of all rows"
