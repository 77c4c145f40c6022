from bridge.reasons.codes import Code
from bridge.wire.messages import Verdict
from estimator.offline import recordings
from tests.estimator.calibration.sessions import in_poses
from tests.estimator.stream import calibration
from tests.sentences import codes


def test_few_poses_are_not_enough() -> None:
    for of in (in_poses(13, 4), calibration(seed=33)):
        result, _ = recordings.calibrate(of.recording(), "accel_aided")
        assert result.verdict is Verdict.REPEAT
        assert Code.TOO_FEW_POSES in codes(result.reason)
        assert result.repeat == (0, 1, 2)
