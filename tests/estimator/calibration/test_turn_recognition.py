from collections.abc import Sequence

import numpy as np
import pytest

from bridge.sim.imu_errors import ImuSpec
from bridge.sim.motion import Still, Turn
from bridge.sim.motion_scripts import SessionPlan, TurnPlan
from tests.estimator.calibration.sessions import ignored, turns
from tests.estimator.stream import Stream, calibration, stream

ONE_GO = np.array([[0.0, 1.0, 1.0]])


def constant_rate(axis: Sequence[float], angle_deg: float, duration_s: float) -> Stream:
    """A machine's turn between two rests: from nothing to full rate at once."""
    of = stream([Still(8.0 + duration_s)], 8.0 + duration_s, spec=ImuSpec(scale=(1.0, 1.0)))
    part = slice(of.at(4.0), of.at(4.0 + duration_s))
    of.gyro[part] += np.radians(angle_deg) / (part.stop - part.start) * 104.0 * np.array(axis)
    return of


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("angle", [360.0, -360.0])
@pytest.mark.parametrize("goes", [1, 4])
def test_a_full_turn_is_one_whichever_way_and_in_however_many_goes(axis: int, angle: float, goes: int) -> None:
    of = calibration(TurnPlan(axis, angle, goes=goes, duration_s=5.0))
    (turn,) = turns(of)
    assert turn.axis == axis
    assert np.sign(turn.samples.gyro[:, axis].mean() - turn.before.bias[axis]) == np.sign(angle)


@pytest.mark.parametrize("angle", [30.0, 90.0, 180.0, 720.0, -720.0, 1080.0])
@pytest.mark.parametrize("accel", [True, False])
def test_other_angles_are_not(angle: float, accel: bool) -> None:
    of = calibration(TurnPlan(0, angle), seed=3)
    assert turns(of, accel=accel) == []
    assert ignored(of, accel=accel)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("angle", [270.0, 330.0, 345.0, 354.0, 366.0, 390.0, 450.0])
def test_with_gravity_a_turn_that_misses_its_start_is_found_out(axis: int, angle: float) -> None:
    for seed in range(3):
        of = calibration(TurnPlan(axis, angle), seed=seed)
        assert turns(of) == []
        assert any("tilted" in reason or "full turn" in reason for reason in ignored(of))


def test_a_turn_about_a_slanting_axis_names_the_share() -> None:
    axis = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
    of = stream([Still(4.0), Turn(5.0, axis, 2 * np.pi, ONE_GO * [1, 5, 1]), Still(4.0)], 13.0)
    assert turns(of) == []
    assert "not about one axis" in ignored(of)[0]


@pytest.mark.parametrize("seed", range(5))
def test_a_swing_to_another_pose_is_no_turn(seed: int) -> None:
    of = calibration(TurnPlan(seed % 3, swing=True), seed=seed)
    assert turns(of) == []
    assert len(ignored(of)) == 1


def test_clipped_samples_are_named() -> None:
    of = calibration(TurnPlan(1, duration_s=4.0))
    middle = of.at(1.5 + 3.2 + 2.0)
    assert "too fast for the gyro's range in 3 samples" in ignored(of, clipped=slice(middle, middle + 3))[0]
    assert ignored(of, clipped=slice(10, 20)) == [], "clipped, but not in the turn"


def test_missing_samples_are_named() -> None:
    of = calibration(TurnPlan(2, duration_s=5.0))
    gone = of.at(1.5 + 3.2 + 2.0)
    keep = np.r_[0:gone, gone + 20 : len(of)]
    cut = of.only(keep)
    assert turns(cut) == []
    assert "0.20 s of samples were lost" in ignored(cut)[0]


@pytest.mark.parametrize("duration_s", [18.0, 22.0, 25.0, 30.0])
def test_a_slow_even_turn_is_neither_a_turn_nor_a_rest(duration_s: float) -> None:
    # After 20 s of it the rate may be a new rest; the piece before must not pass for a whole turn.
    assert turns(constant_rate([0, 0, 1], 360.0, duration_s), accel=False) == []


def test_a_rest_that_is_a_slow_movement_spoils_its_turn() -> None:
    of = calibration(TurnPlan(2), spec=ImuSpec(scale=(1.0, 1.0)))
    of.gyro[: of.at(4.0)] += np.radians(0.8)
    assert turns(of, accel=False) == []
    assert "did not rest" in ignored(of, accel=False)[0]


@pytest.mark.parametrize("k", [0.71, 0.85, 1.2, 1.39])
def test_any_believable_scale(k: float) -> None:
    of = calibration(spec=ImuSpec(scale=(k, k)))
    assert [turn.axis for turn in turns(of)] == [0, 1, 2]


@pytest.mark.parametrize("k", [0.5, 2.0])
def test_a_wrong_sample_rate_is_no_scale(k: float) -> None:
    assert turns(calibration(spec=ImuSpec(scale=(k, k)), plan=SessionPlan())) == []
