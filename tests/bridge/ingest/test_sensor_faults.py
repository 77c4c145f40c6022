"""Sensor faults at the door: seen where the device's own noise forbids what is read, never where it allows it."""

from collections.abc import Callable
from itertools import pairwise
from math import sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.signal import butter, lfilter

from bridge.ingest.sensor_faults import Repeats, SensorFaults
from bridge.wire.messages import SampleFlag
from bridge.wire.refusal import Tally

RATE = 104.0
YEARS = 100 * 365.25 * 86_400 * RATE  # pairs of readings in a hundred device years
Floats = NDArray[np.float64]


def times(n: int) -> Floats:
    return np.arange(n) / RATE


def at_rest(seconds: float, noise_dps: float = 0.03, per_dps: float = 131.0, seed: int = 0) -> NDArray[np.float32]:
    """White noise about a bias that drifts over many steps, in rad/s."""
    rng, n = np.random.default_rng(seed), int(seconds * RATE)
    dps = noise_dps * rng.normal(size=(n, 3)) + rng.uniform(-1, 1, 3) + np.linspace(0, 0.3, n)[:, None]
    return np.radians(np.round(dps * per_dps) / per_dps).astype(np.float32)


def stuck(gyro: NDArray[np.float32]) -> tuple[NDArray[np.bool_], float]:
    """Which readings are called stuck, and how many repeats are needed by then."""
    repeats = Repeats()
    return repeats.seen(times(len(gyro)), gyro), repeats.needed


def test_a_sensor_that_freezes_is_seen_within_fifty_milliseconds_for_as_long_as_it_does() -> None:
    gyro = at_rest(90)
    at = 60 * 104
    gyro[at : at + 300] = gyro[at]
    flagged, needed = stuck(gyro)
    assert needed == 5
    assert needed / RATE < 0.05
    assert np.flatnonzero(flagged).tolist() == list(range(at + 5, at + 300))


def test_noise_repeats_itself_as_seldom_as_is_reckoned() -> None:
    gyro = at_rest(3000)
    same = (np.diff(gyro, axis=0) == 0).all(axis=1)
    p = (1 / (2 * sqrt(np.pi) * 0.03 * 131)) ** 3
    assert same.mean() == pytest.approx(p, rel=0.4)  # 3.6e-4
    flagged, needed = stuck(gyro)
    assert not flagged.any()
    assert p**needed * YEARS < 1e-5


@pytest.mark.parametrize(("noise_dps", "per_dps"), [(0.03, 16.4), (0.005, 131.0)])
def test_a_sensor_coarser_than_its_noise_is_never_called_stuck(noise_dps: float, per_dps: float) -> None:
    flagged, needed = stuck(at_rest(600, noise_dps, per_dps))
    assert needed == np.inf
    assert not flagged.any()


def polled_too_often(n: int, rng: np.random.Generator) -> Floats:
    return np.repeat(rng.normal(size=(n // 4, 3)), 4, axis=0)


def low_passed(n: int, rng: np.random.Generator) -> Floats:
    b, a = butter(2, 20 / 52)
    return np.asarray(lfilter(b, a, rng.normal(size=(n, 3)), axis=0))


@pytest.mark.parametrize("shape", [polled_too_often, low_passed])
def test_noise_that_is_not_white_needs_more_repeats(shape: Callable[[int, np.random.Generator], Floats]) -> None:
    dps = 0.06 * shape(int(600 * RATE), np.random.default_rng(2))
    flagged, needed = stuck(np.radians(np.round(dps * 131) / 131).astype(np.float32))
    assert needed > 5
    assert not flagged.any()


def test_before_its_noise_is_known_nothing_is_called_stuck() -> None:
    gyro = at_rest(9)
    gyro[500:] = gyro[500]
    flagged, needed = stuck(gyro)
    assert needed == np.inf
    assert not flagged.any()


@settings(max_examples=20)
@given(st.lists(st.integers(0, 1700), max_size=40), st.integers(1100, 1500))
def test_however_it_is_batched_the_same_readings_are_called_stuck(cuts: list[int], begins: int) -> None:
    gyro = at_rest(17)
    gyro[begins : begins + 40] = gyro[begins]
    expected, _ = stuck(gyro)
    assert expected.any()
    repeats, time_s = Repeats(), times(len(gyro))
    parts = [repeats.seen(time_s[a:b], gyro[a:b]) for a, b in pairwise(sorted({0, *cuts, len(gyro)}))]
    np.testing.assert_array_equal(np.concatenate(parts), expected)


@pytest.mark.data
@pytest.mark.parametrize(
    "name",
    ["sunsided_mpu6050/unmoved-x-pointing-forward", "mikoff_mpu9150/imu3", "imucal/ferraris_session",
     "broad/10_undisturbed_slow_translation_A", "xio_fusion/sensor_data"],
)  # fmt: skip
def test_real_sensors_are_never_called_stuck(name: str, shared_data: object) -> None:
    with np.load(f"{shared_data}/{name}.npz") as file:
        flagged, _ = stuck(file["gyro_rad_s"].astype(np.float32))
    assert not flagged.any()


def leapt(temperature_c: Floats | list[float], rate_hz: float = 10.0) -> list[int]:
    """The samples whose temperature is not believed."""
    warm, events = np.asarray(temperature_c, np.float32), Tally()
    gyro = np.random.default_rng(0).normal(size=(len(warm), 3)).astype(np.float32)
    flags = SensorFaults(events).flags(np.arange(len(warm)) / rate_hz, gyro, warm, 0.0)
    at: list[int] = np.flatnonzero(flags & SampleFlag.TEMPERATURE_STEP).tolist()
    assert events.as_dict().get("temperature_step", 0) == len(at)
    return at


def test_a_temperature_that_leaps_and_comes_back_is_not_believed_meanwhile() -> None:
    warm = np.linspace(25, 26, 100)
    warm[40:45] = -40.0
    warm[60] = 85.0
    assert leapt(warm) == [40, 41, 42, 43, 44, 60]


def test_a_level_that_stays_is_believed_once_there_was_time_to_get_there() -> None:
    warm = np.full(300, 25.0)
    warm[50:] = 31.0
    assert leapt(warm) == list(range(50, 89))


@pytest.mark.parametrize("n", [7, 600])
def test_what_a_sensor_can_do_is_believed(n: int) -> None:
    warming = 25 + 10 * (1 - np.exp(-np.arange(600) / 10.0 / 20.0))  # power-up, 0.5 K/s at first
    assert leapt(np.round(warming)[:n]) == []  # a coarse thermometer
    assert leapt(np.repeat(warming[::10], 10)[:n]) == []  # one that is read once a second


def test_after_a_silence_another_temperature_is_no_leap() -> None:
    warm = np.array([25.0, 25.0, 35.0, 35.0], np.float32)
    gyro = np.random.default_rng(0).normal(size=(4, 3)).astype(np.float32)
    flags = SensorFaults(Tally()).flags(np.array([0.0, 0.1, 60.0, 60.1]), gyro, warm, 0.0)
    assert not flags.any()
