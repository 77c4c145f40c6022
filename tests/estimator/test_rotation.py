import numpy as np
import pytest

from estimator import rotation


def test_a_full_turn_comes_back() -> None:
    n = 500
    rate = np.tile([0.0, 0.0, 2 * np.pi], (n, 1))
    path = rotation.attitudes(rate, np.full(n, 1 / n))
    np.testing.assert_allclose(path[-1], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(path[n // 4] @ [1, 0, 0], [0, 1, 0], atol=1e-12)


def test_attitudes_take_body_vectors_to_the_start() -> None:
    # A quarter turn about x, then one about the new y: the body's z then points along the first x.
    path = rotation.attitudes(np.array([[np.pi / 2, 0, 0], [0, np.pi / 2, 0]]), np.ones(2))
    np.testing.assert_allclose(path[1] @ [0, 1, 0], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(path[2] @ [0, 0, 1], [1, 0, 0], atol=1e-12)


@pytest.mark.parametrize("vector", [[0.0, 0.0, 0.0], [1e-9, 0.0, 0.0], [0.3, -2.0, 1.0], [np.pi - 1e-6, 0.0, 0.0]])
def test_log_is_the_rotation_vector(vector: list[float]) -> None:
    attitude = rotation.attitudes(np.array([vector]), np.ones(1))[-1]
    np.testing.assert_allclose(rotation.log(attitude), vector, atol=1e-9)


def test_a_sample_holds_over_the_interval_that_ends_at_it() -> None:
    np.testing.assert_allclose(rotation.intervals(np.array([1.0, 1.1, 1.3, 1.4])), [0.1, 0.1, 0.2, 0.1])
    np.testing.assert_array_equal(rotation.intervals(np.array([1.0])), [0.0])


def test_angle_between() -> None:
    assert rotation.angle_between(np.array([1.0, 0, 0]), np.array([0, 2.0, 0])) == pytest.approx(np.pi / 2)
    assert rotation.angle_between(np.array([1.0, 0, 0]), np.array([1.0, 1e-9, 0])) == pytest.approx(1e-9)
    assert rotation.angle_between(np.array([1.0, 0, 0]), np.array([-3.0, 0, 0])) == pytest.approx(np.pi)
