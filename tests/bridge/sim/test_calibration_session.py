import numpy as np
import pytest

from bridge.sim.calibration_session import simulate_session
from bridge.sim.quaternion import to_rotvec
from tests.sim.attitude import integrate


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
