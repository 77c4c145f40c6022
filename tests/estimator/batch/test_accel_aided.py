import numpy as np

from bridge.reasons.codes import Code
from bridge.wire.messages import Verdict
from estimator import offline
from estimator.batch.accel_aided import gravity_of
from estimator.batch.carry import COLUMN, MATRIX_PARAMETERS, ROW
from tests.estimator.batch.sessions import in_poses, movements
from tests.estimator.stream import calibration
from tests.sentences import codes


def test_many_poses_give_the_matrix_as_transitions_do() -> None:
    of = in_poses(11, 18)
    result, _ = offline.calibrate(of.recording(), "accel_aided")
    other, _ = offline.calibrate(of.recording(), "transitions")
    assert result.verdict is Verdict.ACCEPTED
    assert result.parameters == MATRIX_PARAMETERS
    np.testing.assert_allclose(result.matrix, of.truth.matrix, atol=1e-3)
    np.testing.assert_allclose(result.matrix, other.matrix, atol=1e-3)
    assert np.abs(result.matrix - of.truth.matrix).max() < 6 * np.sqrt(np.diag(result.covariance)[3:]).max()


def test_its_accelerometer_comes_out_unit_and_unbiased() -> None:
    of = in_poses(12, 16)
    accel = np.array([rest.accel for rest in movements(of).rests])
    true = accel - of.truth.accel_bias
    found = gravity_of(accel)
    np.testing.assert_allclose(found, true / np.linalg.norm(true, axis=1)[:, None], atol=2e-3)


def test_what_its_accelerometer_takes_for_gravity_is_exact_without_noise() -> None:
    g = np.random.default_rng(5).normal(size=(16, 3))
    g /= np.linalg.norm(g, axis=1)[:, None]
    scale = np.array([[1.02, 0.01, -0.02], [0.0, 0.99, 0.015], [0.0, 0.0, 0.98]])
    np.testing.assert_allclose(gravity_of(9.80665 * g @ np.linalg.inv(scale).T + [0.1, -0.2, 0.3]), g, atol=1e-9)


def test_few_poses_are_not_enough() -> None:
    for of in (in_poses(13, 4), calibration(seed=33)):
        result, _ = offline.calibrate(of.recording(), "accel_aided")
        assert result.verdict is Verdict.REPEAT
        assert Code.TOO_FEW_POSES in codes(result.reason)
        assert result.repeat == (0, 1, 2)


def test_its_deviations_know_of_errors_that_poses_share() -> None:
    """By the residuals of the movements alone the matrix was off by 1.5 to 1.7 standard deviations, rms (12 to 18 poses)."""
    nees = []
    for seed in range(40, 58):
        of = in_poses(seed, 14)
        result, _ = offline.calibrate(of.recording(), "accel_aided")
        if result.verdict is Verdict.ACCEPTED:
            error = result.matrix[ROW, COLUMN] - of.truth.matrix[ROW, COLUMN]
            nees.append(error @ np.linalg.solve(result.covariance[3:, 3:], error) / 9)
    assert len(nees) > 15
    assert 0.6 < np.mean(nees) < 1.5
