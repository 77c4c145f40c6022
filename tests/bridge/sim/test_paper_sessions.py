import numpy as np
import pytest

from bridge.sim.paper_sessions import PaperPlan, draw_gyro, simulate
from bridge.sim.quaternion import to_rotvec
from tests.sim.attitude import integrate

START = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(("wobble_deg", "replacement_deg"), [(0.0, 0.0), (3.0, 0.0), (0.0, 1.0), (5.0, 0.5)])
def test_a_turn_ends_where_it_should(wobble_deg: float, replacement_deg: float) -> None:
    rng = np.random.default_rng(1)
    found = simulate(draw_gyro(rng), PaperPlan(0.0, wobble_deg, replacement_deg, rate_hz=52.0), 4, rng)
    misses = [
        to_rotvec(integrate(rates, dt, START)[-1:])[0]
        for rates, dt in zip(found.rates.reshape(12, -1, 3), found.dt.reshape(12, -1), strict=True)
    ]
    if replacement_deg:
        assert np.degrees(np.std(misses)) == pytest.approx(replacement_deg, rel=0.5)
    else:
        np.testing.assert_allclose(misses, 0.0, atol=1e-9)


def test_readings_are_the_gyros() -> None:
    rng = np.random.default_rng(2)
    gyro = draw_gyro(rng)
    found = simulate(gyro, PaperPlan(0.0), 3, rng)
    np.testing.assert_allclose(gyro.k * (found.turns - gyro.bias), found.rates, atol=1e-12)
    np.testing.assert_allclose(found.rests, np.broadcast_to(gyro.bias, found.rests.shape))
    assert found.rests.shape == (3, 4, 312, 3)
    assert (gyro.k >= 0.8).all()
    assert (gyro.k <= 1.2).all()
    assert np.degrees(np.abs(gyro.bias)).max() <= 5


def test_points_are_the_rate_itself_and_means_its_mean() -> None:
    """Means over short intervals, taken at their middles, are points."""
    point = PaperPlan(0.0, wobble_deg=3.0, rate_hz=100.0, sampling="point", turn_s=(4.0, 4.0))
    mean = PaperPlan(0.0, wobble_deg=3.0, rate_hz=1000.0, turn_s=(4.0, 4.0))
    points, fine = (
        simulate(draw_gyro(rng), plan, 2, rng)
        for rng, plan in ((np.random.default_rng(7), point), (np.random.default_rng(7), mean))
    )
    between = (fine.rates[:, :, 9:-1:10] + fine.rates[:, :, 10::10]) / 2
    np.testing.assert_allclose(points.rates[:, :, :-1], between, atol=2e-3)
    np.testing.assert_allclose(points.rates[:, :, -1], 0.0, atol=1e-4)
