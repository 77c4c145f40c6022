from math import radians

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.stillness.detector import NEW_REFERENCE_S, Stillness, Window

Floats = NDArray[np.float64]
RATE = 104.0


def noise(n: int, dps: float = 0.03, seed: int = 0) -> Floats:
    return np.asarray(radians(dps) * np.random.default_rng(seed).normal(size=(n, 3)))


def windows(gyro: Floats, *, rate: float = RATE, accel: Floats | None = None, start: float = 0.0) -> list[Window]:
    return list(Stillness().feed(start + np.arange(1, len(gyro) + 1) / rate, gyro, accel))


def still_share(found: list[Window]) -> float:
    return float(np.mean([w.still for w in found]))


@pytest.mark.parametrize("rate", [50.0, 100.0, 104.0, 208.0, 400.0])
@pytest.mark.parametrize("bias_dps", [0.0, 10.0, -10.0])
def test_a_rest_is_still_at_any_rate_and_any_bias(rate: float, bias_dps: float) -> None:
    found = windows(noise(int(6 * rate)) + np.radians(bias_dps), rate=rate)
    assert all(w.still for w in found)
    assert len(found) >= 30


@pytest.mark.parametrize("dps", [0.01, 0.03, 0.15, 0.3])
def test_a_noisy_device_rests_too(dps: float) -> None:
    assert still_share(windows(noise(2000, dps))) > 0.99


def test_a_device_that_is_told_to_send_faster_rests_on_though_its_readings_are_noisier() -> None:
    stillness, slow, fast = Stillness(), 10.0, 400.0
    per_root_hz = 0.04
    list(stillness.feed(np.arange(1, 301) / slow, noise(300, per_root_hz * (slow / 2) ** 0.5), None))
    before = stillness.noise_std
    time = 30.0 + np.arange(1, 4001) / fast
    found = list(stillness.feed(time, noise(4000, per_root_hz * (fast / 2) ** 0.5, seed=1), None))
    assert still_share(found) > 0.99
    assert stillness.noise_std / before == pytest.approx(np.full(3, (fast / slow) ** 0.5), rel=0.2)
    list(stillness.feed(time[-1] + np.arange(1, 301) / slow, noise(300, per_root_hz * (slow / 2) ** 0.5, seed=2), None))
    assert stillness.noise_std / before == pytest.approx(np.ones(3), rel=0.3)


def test_the_noise_is_learnt_from_a_rest() -> None:
    stillness = Stillness()
    before = stillness.noise_known
    list(stillness.feed(np.arange(1, 501) / RATE, noise(500, 0.08), None))
    assert (before, stillness.noise_known) == (False, True)
    np.testing.assert_allclose(np.degrees(stillness.noise_std), 0.08, rtol=0.2)


@pytest.mark.parametrize("dps", [3.0, 20.0, 90.0, -200.0])
def test_an_even_turn_is_not_a_rest(dps: float) -> None:
    gyro = noise(1500)
    gyro[520:] += np.array([0.0, np.radians(dps), 0.0])
    found = windows(gyro)
    assert all(w.still for w in found if w.end <= 520)
    assert not any(w.still for w in found if w.end > 520)


def test_a_constant_rate_that_lasts_is_a_new_rest() -> None:
    gyro = noise(4000)
    gyro[520:] += np.radians(8.0)
    still = [w.end_time for w in windows(gyro) if w.still and w.end > 520]
    assert still[0] == pytest.approx(5.0 + NEW_REFERENCE_S, abs=0.5)


def test_quiet_moments_of_a_movement_do_not_add_up_to_a_rest() -> None:
    gyro = noise(int(40 * RATE))
    rough = np.random.default_rng(1).normal(size=gyro.shape)
    for second in range(5, 40):
        part = slice(int(second * RATE), int((second + 1) * RATE))
        gyro[part] += np.radians(30.0) if second % 2 else np.radians(30.0 + 20.0 * rough[part])
    assert not any(w.still for w in windows(gyro) if w.start_time > 5.2)


@pytest.mark.parametrize("slope_dps_per_s", [0.3, 0.5, 1.0])
def test_a_turn_that_begins_slowly_does_not_drag_the_rest_along(slope_dps_per_s: float) -> None:
    gyro = noise(int(25 * RATE))
    t = np.arange(len(gyro)) / RATE
    gyro[:, 2] += np.radians(slope_dps_per_s) * np.clip(t - 5, 0, None)
    moving = [w for w in windows(gyro) if np.degrees(w.mean[2]) > 2.0]
    assert moving
    assert not any(w.still for w in moving)


def test_a_tremor_does_not_teach_itself_to_be_rest() -> None:
    # Six levels, each within five times the one before, up to 1.9 °/s.
    gyro = np.concatenate([noise(400, 0.1 * 1.8**level, seed=level) for level in range(6)])
    last = [w for w in windows(gyro) if w.start >= 2000]
    assert still_share(last) < 0.1


def test_no_stillness_spans_a_gap() -> None:
    stillness = Stillness()
    time = np.arange(1, 1001) / RATE
    time[500:] += 3.0
    found = list(stillness.feed(time, noise(1000), None))
    (over,) = [w for w in found if not w.still]
    assert over.start <= 500 < over.end + 1
    # A gap between two windows counts as well.
    edge = next(w.end for w in found if w.end > 300)
    time = np.arange(1, 1001) / RATE
    time[edge:] += 3.0
    assert [w.start for w in Stillness().feed(time, noise(1000), None) if not w.still] == [edge]


def test_the_accelerometer_knows_of_a_push_that_the_gyro_does_not() -> None:
    accel = np.tile([0.0, 0.0, 9.81], (1000, 1)) + 0.02 * np.random.default_rng(0).normal(size=(1000, 3))
    accel[500:600, 0] += np.sin(np.arange(100))
    found = windows(noise(1000), accel=accel)
    assert not any(w.still for w in found if w.start >= 500 and w.end <= 600)
    assert all(w.still for w in found if w.end < 500 or w.start > 600)
