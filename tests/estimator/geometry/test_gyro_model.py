import numpy as np
import pytest

from estimator.geometry.gyro_model import (
    COARSE_STEP,
    GyroModel,
    PriorKnobs,
    least_step,
    mean_var,
    reading_std,
    repeatability,
    uncalibrated,
)


def test_corrected_is_matrix_times_reading_less_bias() -> None:
    matrix = np.array([[1.1, 0.02, 0.0], [0.0, 0.9, 0.0], [0.0, 0.0, 1.0]])
    model = GyroModel(matrix, np.array([0.1, -0.2, 0.0]), *np.zeros((3, 3)))
    np.testing.assert_allclose(model.correct(np.array([[1.1, 0.8, 0.5]])), [[1.1 * 1.0 + 0.02 * 1.0, 0.9, 0.5]])
    np.testing.assert_allclose(
        model.corrected_std(np.array([0.03, 0.04, 0.05])), [np.hypot(0.033, 0.0008), 0.036, 0.05]
    )


def test_before_anything_is_known_little_is_claimed() -> None:
    model = uncalibrated(PriorKnobs())
    np.testing.assert_array_equal(model.correct(np.ones((1, 3))), np.ones((1, 3)))
    assert (model.scale_std >= 0.15).all()


def test_how_far_a_scale_moves_from_boot_to_boot_is_known_by_those_there_were() -> None:
    knobs, one = PriorKnobs(scale_std=0.15), np.array([0.9, 1.0, 1.1])
    assert repeatability([], knobs) == repeatability([one], knobs) == 0.15
    assert repeatability([one] * 2, knobs) == pytest.approx(0.075)
    moved = np.exp(0.1 * np.random.default_rng(0).normal(size=(400, 3)))
    assert repeatability(list(moved), knobs) == pytest.approx(0.1 * np.sqrt(2), rel=0.1)


def test_the_least_step_of_rounded_readings() -> None:
    rng = np.random.default_rng(0)
    fine = rng.normal(size=(300, 3))
    np.testing.assert_allclose(least_step(0.25 * np.round(fine / 0.25)), 0.25)
    assert (least_step(fine) < 1e-2).all()
    np.testing.assert_array_equal(least_step(np.ones((10, 3))), COARSE_STEP)


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.1, 0.2, 0.3, 1.0])
def test_the_variance_of_a_mean_of_rounded_readings_is_honest(noise: float) -> None:
    """In steps: many true values, each read 300 times with this noise and rounded."""
    rng = np.random.default_rng(1)
    scores = []
    for _ in range(200):
        true = rng.uniform(-1, 1, 3) * COARSE_STEP * 3
        read = COARSE_STEP * np.round(true / COARSE_STEP + noise * rng.normal(size=(300, 3)))
        var = mean_var(read.std(axis=0, ddof=1), least_step(read), 300)
        scores.append((read.mean(axis=0) - true) ** 2 / var)
    assert 0.01 < np.mean(scores) < 1.6


def test_a_reading_without_noise_is_still_rounded() -> None:
    rounding = COARSE_STEP / 12**0.5
    np.testing.assert_allclose(reading_std(np.array([0.0, 0.002, 1e-17])), [rounding, 0.002, rounding])
    np.testing.assert_allclose(reading_std(np.array([0.002, np.nan, 0.003])), [0.002, rounding, 0.003])
    np.testing.assert_array_equal(reading_std(np.array([0.002, 0.001, 0.003])), [0.002, 0.001, 0.003])
