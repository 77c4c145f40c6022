import numpy as np
import pytest

from bridge.reasons.codes import Code
from bridge.sim.imu_errors import ImuSpec
from bridge.wire.messages import Verdict
from estimator.calibration.constant_rates import nearest_rates, plateaus
from estimator.calibration.turntable import by_turntable
from estimator.offline import recordings
from tests.estimator.calibration.machines import TABLE_DPS, on_a_turntable, samples, turned
from tests.estimator.calibration.sessions import in_poses
from tests.sentences import codes

RATES = tuple(np.radians(TABLE_DPS))


def test_the_fit_is_the_closed_form_of_two_rates_either_way() -> None:
    """Per axis, k is the span of the true rates over the span of the readings: the textbook's six-rate formula."""
    of = on_a_turntable(2, misalignment_deg=0.0)
    result = by_turntable(samples(of), RATES)
    spins = [p for p in plateaus(samples(of)) if np.abs(p.mean).max() > np.radians(15)]
    for axis in range(3):
        true = np.array([r * s for r in RATES for s in (1, -1)])
        own = np.array([p.mean[axis] for p in spins if np.argmax(np.abs(p.mean)) == axis])
        textbook = (true @ (true - true.mean())) / (own @ (true - true.mean()))
        assert result.scale[axis] == pytest.approx(textbook, abs=3e-5)


@pytest.mark.parametrize("k", [0.75, 0.9, 1.0, 1.2, 1.35])
def test_known_rates_are_told_apart_whatever_the_scale(k: float) -> None:
    true = np.radians([30.0, 60, 90, 30, 90])
    np.testing.assert_array_equal(nearest_rates(true / k, RATES), true)


def test_other_rates_are_left_out_and_said() -> None:
    of = turned(np.eye(3), (*TABLE_DPS, 45.0, 6.0), 4, ImuSpec())
    result = by_turntable(samples(of), RATES)
    assert result.verdict is Verdict.ACCEPTED
    assert [one.params.get("spins") for one in result.reason] == ["18", None]
    assert Code.STRETCHES_LEFT_OUT(stretches=12, clipped=0) in result.reason
    np.testing.assert_allclose(result.scale, of.truth.k, atol=3e-4)


def test_stretches_beyond_the_range_are_left_out_whether_it_is_told_or_not() -> None:
    of = turned(np.eye(3), TABLE_DPS, 4, ImuSpec(scale=(0.9, 0.95), range_dps=80.0))
    result = by_turntable(samples(of), RATES)
    assert result.verdict is Verdict.REFUSED
    assert Code.STRETCHES_LEFT_OUT in codes(result.reason)
    left = by_turntable(samples(of), RATES[:2])
    assert left.verdict is Verdict.ACCEPTED
    np.testing.assert_allclose(left.scale, of.truth.k, atol=1e-3)


def test_an_axis_not_turned_is_asked_for() -> None:
    of = turned(np.eye(3)[:2], TABLE_DPS, 4, ImuSpec())
    result = by_turntable(samples(of), RATES)
    assert (result.verdict, result.repeat) == (Verdict.REPEAT, (2,))


def test_wrong_rates_are_refused() -> None:
    result = by_turntable(samples(on_a_turntable(5)), tuple(np.radians([31.0, 57.0, 90.0])))
    assert result.verdict is Verdict.REFUSED
    assert {Code.TABLE_RATE_MISSING, Code.TABLE_MISFIT} & {*codes(result.reason)}
    half = by_turntable(samples(on_a_turntable(5)), tuple(np.radians([10.0, 20.0, 30.0])))
    assert half.verdict is Verdict.REFUSED


def test_a_recording_made_by_hand_has_no_constant_rates() -> None:
    result, _ = recordings.calibrate(in_poses(8, 6).recording(), "turntable", rates=RATES)
    assert (result.verdict, result.repeat) == (Verdict.REPEAT, (0, 1, 2))
    assert not np.isfinite(result.covariance).any()
