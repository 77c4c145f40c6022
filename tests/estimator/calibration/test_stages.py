import numpy as np
import pytest

from bridge.sim.motion_scripts import SessionPlan, TurnPlan
from estimator.calibration.capture import History
from estimator.calibration.stages import LONGEST_S, Settled, Stages
from estimator.stillness.detector import Stillness, Windows
from tests.estimator.stream import Stream, calibration


def settled(of: Stream) -> list[Settled]:
    history, windows = held(of)
    stages = Stages(history)
    found = [stages.take(begun, ended, still=still) for begun, ended, _, still in windows.heads]
    return [s for s in found if s is not None]


def held(of: Stream) -> tuple[History, Windows]:
    """The samples of a stream in a history, and their windows."""
    history, windows = History(), Stillness().feed(of.time, of.gyro, of.accel)
    history.take(windows.samples[1])
    return history, windows


@pytest.mark.parametrize("rate_hz", [10.0, 12.5, 25.0])
@pytest.mark.parametrize("seed", range(4))
def test_three_seconds_are_a_rest_at_any_rate(rate_hz: float, seed: int) -> None:
    """Windows of six samples last 0.6 s at 10 Hz: all of the first was held to be movement, and 3 s to be too short."""
    plan = SessionPlan(turn_s=(4.0, 5.0), rests_s=3.0)
    assert len(settled(calibration(seed=seed, rate_hz=rate_hz, before_s=3.0 + seed / 7, plan=plan))) == 4


def test_rests_hold_no_movement_and_movements_hold_all_of_it() -> None:
    of = calibration(seed=5, plan=SessionPlan(turn_s=(4.0, 5.0), wobble_deg=2.0))
    turning = np.linalg.norm(of.rate, axis=1) > np.radians(0.3)
    stages = Stages(held(of)[0])
    for s in settled(of):
        rest = slice(of.at(s.after.start), of.at(s.after.end))
        assert not turning[rest].any()
        if s.before is not None:
            movement = stages.movement(s.before, s.after)
            outside = (of.time >= s.before.start) & (of.time <= s.after.end)
            inside = (of.time >= movement.samples.time[0]) & (of.time <= movement.samples.time[-1])
            assert not turning[outside & ~inside].any()
            # Rest on both sides, as much as there is to give.
            assert s.before.end - movement.samples.time[0] >= 0.3
            assert movement.samples.time[-1] - s.after.start >= 0.3


def test_a_rest_is_the_bias_within_its_own_covariance() -> None:
    of = calibration(seed=6)
    score = []
    for s in settled(of):
        error = s.after.bias - of.bias[0]
        score.append(error @ np.linalg.solve(s.after.bias_cov, error) / 3)
    assert 0.1 < np.mean(score) < 2.5


def test_a_short_pause_belongs_to_the_movement() -> None:
    of = calibration(TurnPlan(0), TurnPlan(1), plan=SessionPlan((3.2, 1.2, 3.2), (TurnPlan(0), TurnPlan(1))))
    assert len(settled(of)) == 2


def test_a_rest_of_hours_is_measured_by_its_latest_part() -> None:
    of = calibration(before_s=100.0)
    first = settled(of)[1].before
    assert first is not None
    assert first.end - first.start == pytest.approx(LONGEST_S, abs=0.1)
