import numpy as np
import pytest

from bridge.reasons.codes import Code
from bridge.recording import Recording
from bridge.sim.imu_errors import ImuSpec
from bridge.sim.motion_scripts import TurnPlan
from bridge.wire.messages import Verdict
from estimator.device.session import DeviceSession
from estimator.offline import recordings
from tests.estimator.stream import NAME, calibration, feed
from tests.sentences import codes


def test_live_and_from_a_file_are_one_calibration() -> None:
    of = calibration(seed=2, before_s=40.0)
    live = feed(DeviceSession(NAME), of.batches()).calibration
    gyro, accel = (values.astype(np.float32).astype(float) for values in (of.gyro, of.accel))
    whole, _ = recordings.calibrate(Recording(of.time, gyro, accel, None, 104.0, ""))
    assert live is not None
    np.testing.assert_allclose(np.diag(live.matrix), whole.scale, atol=5e-6)


def test_what_was_passed_over_is_told_with_its_time() -> None:
    of = calibration(TurnPlan(0), TurnPlan(1, 180.0), TurnPlan(2), seed=3)
    result, passed_over = recordings.calibrate(of.recording())
    assert result.verdict is Verdict.REPEAT
    assert result.repeat == (1,)
    assert Code.NO_FULL_TURN in codes(result.reason)
    assert Code.TURN_TOO_SHORT in codes(result.reason)
    (words,) = passed_over
    assert float(words.split(" s:")[0]) == pytest.approx(1.5 + 3 * 3.2 + 2 * 4.5 - 1, abs=2.0)


def test_a_known_range_shows_what_was_clipped() -> None:
    of = calibration(seed=4, spec=ImuSpec(scale=(1.0, 1.0), bias_limit_dps=1.0, noise_dps=0.3))
    limit = np.radians(100.0)
    clipped = Recording(of.time, np.clip(of.gyro, -limit, limit), of.accel, None, 104.0, "")
    result, passed_over = recordings.calibrate(clipped, gyro_range=limit)
    assert result.verdict is Verdict.REPEAT
    assert len(passed_over) == 3
    assert all("too fast for the gyro's range" in words for words in passed_over)


def test_nothing_but_rest_is_no_session() -> None:
    of = calibration(seed=5)
    still = of.part(0, of.at(4.5))
    result, passed_over = recordings.calibrate(still.recording())
    assert (result.verdict, result.repeat, passed_over) == (Verdict.REPEAT, (0, 1, 2), [])
