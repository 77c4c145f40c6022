"""Are calibrations on a turntable and a servo as sure as they say? A few recordings of a simulator that shares no code.

The whole table: python -m tests.bench.machines.
"""

import numpy as np
import pytest

from estimator.calibration.bias_wander import WanderKnobs
from estimator.noise.device_model import GENERIC, load_model
from tests.bench.machines import calibrated, cases

CASES = {case.name: case for case in cases()}


@pytest.mark.parametrize(
    ("name", "runs"),
    [
        ("servo 90 mg, x y z up", 24),
        ("servo askew, misalignment 0.57°", 24),
        ("servo warming 0.1 °/s/min", 16),
        ("table 640 s, flicker 0.014", 8),
        ("table 200 s", 16),
        ("table flicker 0.03", 4),
        ("table also 45 and 5 °/s, not told", 3),
    ],
)
def test_what_is_good_is_accepted_and_as_sure_as_it_says(name: str, runs: int) -> None:
    found = [calibrated(CASES[name], seed) for seed in range(runs)]
    assert all(one.accepted for one in found), [one.said for one in found]
    assert not any(one.wrong for one in found)
    assert 0.25 < np.mean([one.nees for one in found]) < 2.0


@pytest.mark.parametrize("name", [name for name in CASES if " wrong: " in name])
def test_a_wrong_rate_is_not_accepted(name: str) -> None:
    assert not any(calibrated(CASES[name], seed).accepted for seed in range(4))


def test_a_bias_of_which_nothing_is_told_wanders_as_that_of_the_generic_model() -> None:
    knobs, model = WanderKnobs(), load_model(GENERIC)
    np.testing.assert_allclose(model.bias_instability, knobs.bias_instability)
    np.testing.assert_allclose(model.rrw, knobs.rate_random_walk)
