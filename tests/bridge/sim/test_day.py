"""Days on a ward: exact mathematics of the motion, and statistics as declared of the sensor."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.sim.body import Body, Lived
from bridge.sim.motion import GRAVITY
from bridge.sim.wearer import Wearer
from tests.sim.day import Day, anyhow, simulate_day, worn_spec
from tests.sim.warmth import ROOM_C

RATE_HZ = 52.0
LEVER = np.array([0.2, -0.05, 0.1])


def times(seconds: float, rate_hz: float = RATE_HZ) -> NDArray[np.float64]:
    return np.arange(1, int(seconds * rate_hz) + 1) / rate_hz


def body(seed: int) -> Body:
    rng = np.random.default_rng(seed)
    return Body(Wearer(rng).life(), LEVER, anyhow(rng))


@pytest.fixture(scope="module")
def hours() -> list[Lived]:
    """Half an hour of two lives, whole."""
    return [body(seed).advance(times(1800)) for seed in range(2)]


@pytest.fixture(scope="module")
def day() -> Day:
    return simulate_day(3, hours=1.5, rate_hz=RATE_HZ)


def test_rates_integrate_to_the_attitudes(hours: list[Lived]) -> None:
    for lived in hours:
        attitude = Rotation.from_quat(lived.attitude, scalar_first=True)
        dt = np.diff(lived.time_s)
        step = Rotation.from_rotvec(lived.rate[1:] * dt[:, None])
        assert ((attitude[:-1] * step).inv() * attitude[1:]).magnitude().max() < 1e-9


def test_force_is_gravity_and_the_change_of_a_bounded_velocity(hours: list[Lived]) -> None:
    for lived in hours:
        attitude = Rotation.from_quat(lived.attitude, scalar_first=True)
        acceleration = np.diff(lived.velocity, axis=0) / np.diff(lived.time_s)[:, None]
        force = attitude[1:].inv().apply(acceleration + np.array([0, 0, GRAVITY]))
        np.testing.assert_allclose(lived.force[1:], force, atol=1e-8)
        assert 0.3 < np.linalg.norm(lived.velocity, axis=1).max() < 5.0


def test_the_truth_explains_the_readings(day: Day) -> None:
    spec = worn_spec(RATE_HZ)
    left = np.degrees(day.gyro - day.bias - day.rate @ np.linalg.inv(day.truth.matrix).T)
    white = 0.015 * np.sqrt(RATE_HZ / 2)
    assert spec.noise_dps == pytest.approx(white)
    assert left.std(axis=0) == pytest.approx(np.full(3, np.hypot(white, spec.step_dps / np.sqrt(12))), rel=0.02)
    # White: the mean of a second is as much smaller as the square root of its samples, and neighbours are strangers.
    seconds = left[: len(left) // 52 * 52].reshape(-1, 52, 3).mean(axis=1)
    assert seconds.std(axis=0) == pytest.approx(np.full(3, white / np.sqrt(52)), rel=0.06)
    assert np.abs(np.mean(left[1:] * left[:-1], axis=0)).max() < 0.02 * white**2


def test_bias_walks_about_its_temperature_law() -> None:
    ends, law_errors = [], []
    for seed in range(30):
        day = simulate_day(seed, hours=0.1, rate_hz=10.0)
        warmer = day.temperature_c[:, None].astype(float) - ROOM_C
        law = day.truth.turn_on_bias + warmer * day.truth.bias_per_kelvin + warmer**2 * day.truth.bias_per_kelvin2
        walk = np.degrees(day.bias - law)
        law_errors.append(np.abs(walk[0]).max())
        ends.append(walk[-1])
    assert np.max(law_errors) < 2e-3
    assert np.std(ends) == pytest.approx(7e-4 * np.sqrt(360), rel=0.25)
