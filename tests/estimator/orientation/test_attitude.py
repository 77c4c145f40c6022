"""Attitudes against a simulation that shares no code with the estimator, and against SciPy's rotations."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimator.geometry.gyro_model import Floats, GyroModel
from estimator.orientation.attitude import Attitude, Oriented, known, orient
from estimator.orientation.smoothing import smooth
from tests.sim.attitude import integrate
from tests.sim.day import anyhow

RATE_HZ, G = 100.0, 9.80665
BIAS_STD, MATRIX_STD, ACCEL_STD, NOISE = 1e-4, 2e-3, 0.03, 1e-3


class Worn:
    """A device swung about all axes and pushed about, with sensor errors drawn as `KNOWN` tells them."""

    def __init__(self, seed: int, seconds: float = 60.0, *, swing: float = 1.0, errors: float = 1.0) -> None:
        rng, n = np.random.default_rng(seed), round(seconds * RATE_HZ)
        self.time = np.arange(1, n + 1) / RATE_HZ
        pace = rng.uniform(0.2, 1.0, 3)[:, None], rng.uniform(0, 2 * np.pi, 3)[:, None]
        rate = swing * np.sin(2 * np.pi * pace[0] * self.time + pace[1]).T
        rate[: round(2 * RATE_HZ)] = 0.0
        turned = integrate(rate, np.full(n, 1 / RATE_HZ), anyhow(rng))
        self.attitude = Rotation.from_quat(turned, scalar_first=True)
        middle = self.attitude * Rotation.from_rotvec(-rate / RATE_HZ / 2)
        speed = 0.2 * swing * np.sin(2 * np.pi * rng.uniform(0.3, 2.0, 3) * self.time[:, None] + rng.uniform(0, 6, 3))
        push = np.gradient(speed, self.time, axis=0)
        push[: round(2 * RATE_HZ)] = 0.0
        matrix = np.eye(3) + errors * MATRIX_STD * rng.normal(size=(3, 3))
        bias, offset = errors * BIAS_STD * rng.normal(size=3), errors * ACCEL_STD * rng.normal(size=3)
        self.rows = np.full((n, 9), np.nan)
        self.rows[:, 0], self.rows[:, 7] = self.time, 0.0
        self.rows[:, 1:4] = rate @ np.linalg.inv(matrix).T + bias + errors * NOISE * rng.normal(size=(n, 3))
        self.rows[:, 4:7] = (
            middle.inv().apply(push + np.array([0, 0, G])) + offset + errors * 0.02 * rng.normal(size=(n, 3))
        )
        self.push = push

    def without_accelerometer(self) -> Floats:
        rows = self.rows.copy()
        rows[:, 4:7] = np.nan
        return rows


def what_is_known() -> Floats:
    ones = np.ones(3)
    model = GyroModel(np.eye(3), np.zeros(3), MATRIX_STD * ones, MATRIX_STD * ones, NOISE * ones)
    unsure = np.concatenate([np.full(9, MATRIX_STD), ACCEL_STD * ones])
    return known(model, BIAS_STD * ones, unsure, 0.0, 0.0, np.repeat([0.0, 1.0], 3))


KNOWN = what_is_known()


def inclination(found: Oriented, truth: Rotation) -> Floats:
    """Angle between the true and the estimated vertical, rad."""
    up = [rotation.inv().apply([0, 0, 1]) for rotation in (found.rotation, truth)]
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(*up), axis=1), np.sum(up[0] * up[1], axis=1)))


def test_without_errors_it_is_what_scipy_integrates() -> None:
    worn = Worn(1, errors=0.0)
    rows = worn.without_accelerometer()
    found = Attitude().take(rows, KNOWN)
    relative = worn.attitude[0].inv() * worn.attitude
    assert (found.rotation.inv() * relative).magnitude().max() < 1e-9


def test_a_resting_device_is_level_and_its_force_is_gravity() -> None:
    worn = Worn(2, 20.0, swing=0.0, errors=0.0)
    found = Attitude().take(worn.rows, KNOWN)
    assert np.degrees(inclination(found, worn.attitude)).max() < 0.01
    assert np.abs(found.accel).max() < 1e-3


def test_it_finds_the_vertical_though_the_first_reading_was_shaken() -> None:
    worn = Worn(3, 10.0, errors=0.0)
    worn.rows[0, 4:7] += [6.0, -5.0, 4.0]
    found = Attitude().take(worn.rows, KNOWN)
    off = np.degrees(inclination(found, worn.attitude))
    assert off[0] > 20.0
    assert off[500:].max() < 1.0


@pytest.mark.parametrize("parts", [1, 7, 250])
def test_the_bits_do_not_depend_on_the_batching(parts: int) -> None:
    worn = Worn(4, 10.0)
    whole, cut = Attitude(), Attitude()
    expected = whole.take(worn.rows, KNOWN)
    edges = np.linspace(0, len(worn.rows), parts + 1).astype(int)
    found = [cut.take(worn.rows[a:b], KNOWN) for a, b in pairwise(edges.tolist())]
    for column, name in enumerate(Oriented._fields):
        np.testing.assert_array_equal(np.concatenate([one[column] for one in found]), getattr(expected, name))
    np.testing.assert_array_equal(cut.state, whole.state)


def test_a_round_of_many_devices_is_each_for_itself() -> None:
    worn = [Worn(seed, 4.0) for seed in range(3)]
    alone = [Attitude().take(one.rows, KNOWN) for one in worn]
    attitudes = [Attitude() for _ in worn]
    first = [(a, w.rows[:100], KNOWN) for a, w in zip(attitudes, worn, strict=True)]
    then = [(a, w.rows[100:], KNOWN) for a, w in zip(attitudes, worn, strict=True)]
    found = orient([*first, *then])
    for i, expected in enumerate(alone):
        np.testing.assert_array_equal(np.concatenate([found[i].quat_wxyz, found[3 + i].quat_wxyz]), expected.quat_wxyz)


def test_a_saved_state_goes_on_bit_for_bit() -> None:
    worn, whole, before = Worn(5, 10.0), Attitude(), Attitude()
    expected = whole.take(worn.rows, KNOWN)
    before.take(worn.rows[:321], KNOWN)
    after = Attitude(state=before.state).take(worn.rows[321:], KNOWN)
    np.testing.assert_array_equal(after.quat_wxyz, expected.quat_wxyz[321:])
    np.testing.assert_array_equal(after.cov, expected.cov[321:])
    with pytest.raises(ValueError, match="not finite"):
        Attitude(state=np.full_like(before.state, np.nan))


def test_a_reset_makes_the_heading_zero_and_sure_and_keeps_the_tilt() -> None:
    worn, attitude = Worn(6, 30.0), Attitude()
    attitude.take(worn.rows[:2000], KNOWN)
    up = attitude.rotation.inv().apply([0, 0, 1])
    attitude.reset_heading()
    assert attitude.heading == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(attitude.rotation.inv().apply([0, 0, 1]), up, atol=1e-12)
    assert attitude.cov[2, 2] == 0.0
    zero = worn.attitude[1999]
    found = attitude.take(worn.rows[2000:], KNOWN)
    # From then on it is the true attitude, but for the heading at the zero.
    earth = Rotation.from_euler("z", -heading(zero))
    assert np.degrees((found.rotation * (earth * worn.attitude[2000:]).inv()).magnitude()).max() < 3.0
    assert 0 < found.heading_std[-1] < np.radians(5)


def heading(attitude: Rotation) -> float:
    w, _, _, z = attitude.as_quat(scalar_first=True)
    return float(2 * np.arctan2(z, w))


def test_missing_samples_make_it_less_sure() -> None:
    worn = Worn(7, 40.0)
    gone = (worn.time > 20.0) & (worn.time < 20.3)
    whole, holed = Attitude().take(worn.rows, KNOWN), Attitude().take(worn.rows[~gone], KNOWN)
    assert holed.heading_std[-1] > 2 * whole.heading_std[-1]
    long = (worn.time > 20.0) & (worn.time < 25.0)
    lost = Attitude().take(worn.rows[~long], KNOWN)
    assert lost.heading_std[-1] > 1.0, "nobody knows how far it turned in five seconds"
    assert np.degrees(inclination(lost, worn.attitude[~long]))[-500:].max() < 3.0, "gravity levels it again"


def test_readings_at_the_end_of_the_range_make_it_less_sure() -> None:
    worn = Worn(8, 30.0)
    clipped = worn.rows.copy()
    clipped[1000:1100, 7] = 1.0
    sure, unsure = Attitude().take(worn.rows, KNOWN), Attitude().take(clipped, KNOWN)
    assert unsure.heading_std[-1] > 2 * sure.heading_std[-1]


def test_smoothing_levels_better_and_keeps_the_heading() -> None:
    better, worse = [], []
    for seed in range(5):
        worn = Worn(20 + seed, 30.0)
        found, trace = Attitude().traced(worn.rows, KNOWN)
        smoothed = smooth(found, trace, np.full(3, ACCEL_STD))
        after = worn.time > 5
        rms = [np.sqrt(np.mean(inclination(one, worn.attitude)[after] ** 2)) for one in (found, smoothed)]
        worse.append(rms[0])
        better.append(rms[1])
        assert (smoothed.tilt_std <= found.tilt_std + 1e-12).all()
        np.testing.assert_array_equal(smoothed.heading_std, found.heading_std)
    assert np.mean(better) < 0.97 * np.mean(worse)
