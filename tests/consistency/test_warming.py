"""A recording without temperature is honest about a bias that warms up meanwhile; `tests/bench/warming.py` measures more."""

import numpy as np
import pytest

from tests.bench.warming import judged, recording
from tests.sim.day import simulate_day


@pytest.mark.parametrize("accel", [True, False])
def test_the_truth_is_within_what_is_said_of_a_device_without_temperature(*, accel: bool) -> None:
    found = []
    for seed in (10, 11):
        day = simulate_day(seed, 0.25, 52.0)
        found.append(judged(day, recording(day, temperature=False, accel=accel)))
    covered, _, _, std_dps = np.mean(found, axis=0)
    assert covered > 90, "of 95 % of all rows"
    assert std_dps < (0.02 if accel else 0.03), "who knows nothing is right, too"
