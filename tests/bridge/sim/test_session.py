from collections.abc import Callable
from time import perf_counter

import numpy as np
import pytest

from bridge.sim.motion import Motion
from bridge.sim.quaternion import integrate, to_rotvec
from bridge.sim.script import TurnPlan
from bridge.sim.session import Session, simulate_session


def test_corrected_by_its_truth_every_turn_closes() -> None:
    found = simulate_session(1, noise_dps=0.0, wobble_deg=3.0, tilt_deg=5.0)
    dt = np.diff(found.time_s, prepend=0.0)
    assert len(found.stages) == 7
    for first, end in found.stages[1::2]:
        rate = found.truth.k * (found.gyro[first:end] - found.bias[first:end])
        closed = integrate(rate, dt[first:end], np.array([1.0, 0, 0, 0]))
        assert np.linalg.norm(to_rotvec(closed[-1:])) < 1e-9


def test_stages_split_the_session_into_rests_and_turns() -> None:
    found = simulate_session(2, rate_hz=100.0, rests_s=(4.0, 3.0, 3.0, 5.0))
    np.testing.assert_array_equal(found.stages[1:, 0], found.stages[:-1, 1])
    assert found.stages[0, 0] == 0
    assert found.stages[-1, 1] == len(found.ticks)
    for first, end in found.stages[::2]:
        assert not found.motion.rate[first:end].any()
    for first, end in found.stages[1::2]:
        assert 350 <= end - first <= 602
    assert np.diff(found.stages[::2]).ravel() == pytest.approx([400, 300, 300, 500], abs=2)


def test_ticks_are_the_time() -> None:
    found = simulate_session(3)
    np.testing.assert_allclose(found.ticks * 1e-6, found.time_s)
    assert set(np.diff(found.ticks)) == {9615, 9616}


@pytest.mark.parametrize(
    "change", [lambda: simulate_session(4, wobble_deg=3.0), lambda: simulate_session(4, turns=(TurnPlan(0),))]
)
def test_the_seed_is_the_device_whatever_the_motion(change: Callable[[], Session]) -> None:
    np.testing.assert_array_equal(simulate_session(4).truth.matrix, change().truth.matrix)
    assert (simulate_session(5).truth.k != simulate_session(4).truth.k).all()


def test_the_same_arguments_give_the_same_session() -> None:
    np.testing.assert_array_equal(simulate_session(6).gyro, simulate_session(6).gyro)


def test_two_hundred_sessions_are_quick() -> None:
    begin = perf_counter()
    for seed in range(200):
        simulate_session(seed, wobble_deg=3.0)
    assert perf_counter() - begin < 15


def test_past_its_end_a_finite_motion_is_still() -> None:
    assert not Motion([]).advance(np.array([1.0, 2.0])).rate.any()
