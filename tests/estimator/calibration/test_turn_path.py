import numpy as np
import pytest

from estimator.calibration.accelerometer_errors import N, measured
from estimator.calibration.capture import Floats, Samples
from estimator.calibration.turn_path import Path, integrate
from estimator.geometry import rotation

RNG = np.random.default_rng(5)
TIME = np.arange(1, 301) / 100.0
GYRO = np.cumsum(RNG.normal(0, 0.15, (300, 3)), axis=0)
BIAS = np.array([0.02, -0.05, 0.01])
MATRIX = np.eye(3) + 0.05 * RNG.normal(size=(3, 3))


def path(matrix: Floats = MATRIX, bias: Floats = BIAS, gyro: Floats = GYRO) -> Path:
    return integrate(Samples(TIME, gyro, None, np.zeros(300, bool)), matrix, bias, np.full(3, 0.01))


def turned(changed: Path) -> Floats:
    """The small rotation by which an end differs from the first one's."""
    return rotation.log(changed.end @ path().end.T)


def test_the_end_depends_on_matrix_and_bias_as_it_says() -> None:
    of, step = path(), 1e-6
    for i in range(3):
        for j in range(3):
            change = np.zeros((3, 3))
            change[i, j] = step
            np.testing.assert_allclose(turned(path(MATRIX + change)) / step, of.by_matrix[:, i, j], atol=2e-3)
        np.testing.assert_allclose(turned(path(bias=BIAS + step * np.eye(3)[i])) / step, of.by_bias[:, i], atol=2e-3)


def test_its_noise_is_what_repeating_shows() -> None:
    ends = np.array([turned(path(gyro=GYRO + 0.01 * RNG.normal(size=(300, 3)))) for _ in range(400)])
    expected = path().noise
    assert np.trace(np.cov(ends.T) @ np.linalg.inv(expected)) / 3 == pytest.approx(1.0, abs=0.15)


def test_gravity_depends_on_an_accelerometers_errors_as_it_says() -> None:
    accel, errors, step = np.array([3.0, -5.0, 8.0]), np.linspace(0.0, 0.08, N), 1e-7
    g, slope, shape = measured(accel, errors)
    np.testing.assert_allclose(shape, shape.T)
    for p in range(N):
        moved = measured(accel, errors + step * np.eye(N)[p])[0]
        np.testing.assert_allclose((moved - g) / step, slope[:, p], atol=1e-5)
    for i in range(3):
        np.testing.assert_allclose(
            (measured(accel + step * np.eye(3)[i], errors)[0] - g) / step, shape[:, i], atol=1e-6
        )
    np.testing.assert_array_equal(measured(accel, np.zeros(N))[0], accel)
