"""The bench measures what it says: its figures of a peer, its matrix, and the truth itself as a tracker."""

from dataclasses import replace

import numpy as np
import pytest

from tests.bench import broad
from tests.bench.cases import ERROR, KEPT, ROWS, day_cases, turn_cases
from tests.bench.optical import matrix_of
from tests.bench.trackers import Track
from tests.bench.tracking import written
from tests.sim.scenes import rests_and_motion


def simulated() -> broad.Trial:
    """Five minutes with a perfect gyro, as if seen by cameras."""
    day = rests_and_motion(1, 300.0, rate_hz=200.0, rrw_dps_per_sqrt_s=0.0, noise_dps=0.02)
    gyro, accel, bias, attitude = (one.astype(float) for one in (day.gyro, day.accel, day.bias, day.attitude))
    return broad.Trial("99_simulated", 200.0, gyro, accel, day.activity != 0, bias, attitude)


def test_a_turn_that_is_kept_badly_shows_beside_a_mean_that_is_good() -> None:
    kept, error = (next(row for row in ROWS if row.group == group) for group in (KEPT, ERROR))
    assert written(kept, [85.0, 106.0, 109.0]) == "100 (85)"
    assert written(error, [0.01, 0.03]) == "0.0200"
    assert written(kept, None) == "–"


def test_the_optical_fit_finds_the_matrix() -> None:
    matrix = np.eye(3) + 0.01 * np.random.default_rng(1).normal(size=(3, 3))
    trial = simulated()
    inverse = np.linalg.inv(matrix)
    read = replace(trial, gyro=(trial.gyro - trial.bias) @ inverse.T + trial.bias)
    np.testing.assert_allclose(matrix_of([read]), matrix, atol=1e-4)


def test_the_truth_keeps_slow_turns_and_days() -> None:
    for case in [next(turn_cases()), next(day_cases(1, 0.1))]:
        worth = case.judge(Track(case.bias, np.full(case.bias.shape, 1e-6)))
        for row in ROWS:
            if row.name in worth:
                true, within = (0.0, 1e-6) if row.group == ERROR else (100.0, 5.0)
                assert worth[row.name] == pytest.approx(true, abs=within)
                assert row.group != KEPT or "0.1" in row.label
