"""The 95 % intervals of noise coefficients hold the truth about as often as they say."""

import pytest

from estimator.noise.allan_fit import Noise, identify
from tests.estimator.stillness.rest import at_rest

RUNS = 60


@pytest.mark.parametrize(("n", "arw", "rrw"), [(20_000, 0.01, 7e-4), (20_000, 0.01, 3e-3), (3000, 0.01, 1e-3)])
def test_intervals_cover_the_truth(n: int, arw: float, rrw: float) -> None:
    found: list[Noise] = [identify(at_rest(100 + run, n, 10.0, arw, rrw), 10.0) for run in range(RUNS)]
    assert sum(noise.arw.low <= arw <= noise.arw.high for noise in found) >= 0.9 * RUNS
    assert sum(noise.rrw.low <= rrw <= noise.rrw.high for noise in found) >= 0.87 * RUNS
    assert sum(noise.bias_instability.seen for noise in found) <= 0.08 * RUNS


def test_what_is_not_there_is_not_seen() -> None:
    found = [identify(at_rest(300 + run, 3000, 10.0, 0.01, 0.0), 10.0) for run in range(RUNS)]
    assert sum(noise.rrw.seen for noise in found) <= 0.05 * RUNS
    assert sum(noise.bias_instability.seen for noise in found) <= 0.05 * RUNS
