"""A wide prior that does no harm: what evidence does not reach stays near what is usual."""

import numpy as np

from estimator.tracking.usual_bias import nearer

WIDE, USUAL = np.full(3, np.radians(5.0)), np.radians(0.5)
ZERO = np.zeros(3)


def test_an_axis_that_evidence_does_not_reach_stays_near_the_mean_of_the_prior() -> None:
    bias, cov = np.radians([0.3, -0.2, 2.0]), np.diag(np.radians([0.01, 0.01, 4.0]) ** 2)
    found = nearer(bias, cov, ZERO, WIDE, USUAL)
    np.testing.assert_allclose(found[:2], bias[:2], rtol=1e-3)
    assert abs(found[2]) < 0.05 * bias[2]
    mean = np.radians([1.0, 1.0, 1.0])
    np.testing.assert_allclose(nearer(mean + bias, cov, mean, WIDE, USUAL), mean + found)


def test_a_bias_that_is_unusual_is_believed() -> None:
    bias, cov = np.radians([3.0, -0.2, 2.0]), np.diag(np.radians([0.01, 0.01, 4.0]) ** 2)
    np.testing.assert_array_equal(nearer(bias, cov, ZERO, WIDE, USUAL), bias)


def test_a_bias_that_is_known_or_a_narrow_prior_is_left_alone() -> None:
    bias, cov = np.radians([0.3, -0.2, 0.4]), np.radians(0.01) ** 2 * np.eye(3)
    np.testing.assert_array_equal(nearer(bias, cov, ZERO, WIDE, USUAL), bias)
    np.testing.assert_array_equal(nearer(bias, 1e4 * cov, ZERO, np.full(3, USUAL), USUAL), bias)
