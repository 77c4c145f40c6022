import numpy as np

from bridge.reasons.codes import Code
from bridge.wire.messages import Verdict
from estimator.calibration.gravity_propagation import MATRIX_PARAMETERS
from estimator.offline import recordings
from tests.estimator.calibration.sessions import in_poses
from tests.estimator.stream import calibration
from tests.sentences import codes


def test_many_poses_give_the_matrix_as_transitions_do() -> None:
    of = in_poses(11, 18)
    result, _ = recordings.calibrate(of.recording(), "accel_aided")
    other, _ = recordings.calibrate(of.recording(), "transitions")
    assert result.verdict is Verdict.ACCEPTED
    assert result.parameters == MATRIX_PARAMETERS
    np.testing.assert_allclose(result.matrix, of.truth.matrix, atol=1e-3)
    np.testing.assert_allclose(result.matrix, other.matrix, atol=1e-3)
    assert np.abs(result.matrix - of.truth.matrix).max() < 6 * np.sqrt(np.diag(result.covariance)[3:]).max()


def test_few_poses_are_not_enough() -> None:
    for of in (in_poses(13, 4), calibration(seed=33)):
        result, _ = recordings.calibrate(of.recording(), "accel_aided")
        assert result.verdict is Verdict.REPEAT
        assert Code.TOO_FEW_POSES in codes(result.reason)
        assert result.repeat == (0, 1, 2)
