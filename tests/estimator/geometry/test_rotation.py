import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from estimator.geometry import rotation

Floats = NDArray[np.float64]


def test_a_sample_holds_over_the_interval_that_ends_at_it() -> None:
    np.testing.assert_allclose(rotation.intervals(np.array([1.0, 1.1, 1.3, 1.4])), [0.1, 0.1, 0.2, 0.1])
    np.testing.assert_array_equal(rotation.intervals(np.array([1.0])), [0.0])


def one_by_one(rate: Floats, dt: Floats) -> Floats:
    result, attitude = [np.eye(3)], np.eye(3)
    for step in Rotation.from_rotvec(rate * dt[:, None]).as_matrix():
        attitude = attitude @ step
        result.append(attitude)
    return np.array(result)


@pytest.mark.parametrize("n", [1, 2, 7, 8, 9, 16, 17, 63, 64, 65, 640, 3001])
def test_attitudes_are_those_of_products_one_by_one(n: int) -> None:
    rng = np.random.default_rng(n)
    rate, dt = rng.normal(0, 3, (n, 3)), rng.uniform(0.005, 0.02, n)
    np.testing.assert_allclose(rotation.attitudes(rate, dt), one_by_one(rate, dt), atol=1e-12, rtol=0)
