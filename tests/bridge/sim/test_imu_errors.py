from dataclasses import replace
from itertools import pairwise

import allantools
import numpy as np
import pytest

from bridge.sim.imu_errors import DEMO_SPEC, ImuErrorModel, ImuSpec, Readings
from bridge.sim.motion import Motion, Still, TrueMotion
from bridge.sim.motion_scripts import demo_script

PERFECT = ImuSpec(scale=(1, 1), bias_limit_dps=0, noise_dps=0, accel_noise=0)


def truth(duration_s: float = 20.0) -> TrueMotion:
    return demo_script(np.random.default_rng(0)).advance(np.arange(1, int(duration_s * 104)) / 104)


def at_rest(duration_s: float) -> TrueMotion:
    return Motion([Still(1.0)]).advance(np.arange(1, int(duration_s * 104)) / 104)


def read(spec: ImuSpec, motion: TrueMotion, seed: int = 1) -> tuple[ImuErrorModel, Readings]:
    device = ImuErrorModel(spec, np.random.default_rng(seed))
    return device, device.read(motion)


def test_truth_inverts_the_reading() -> None:
    motion = truth()
    spec = replace(DEMO_SPEC, misalignment_deg=2.0, noise_dps=0.0, step_dps=0.0)
    device, readings = read(spec, motion)
    corrected = (readings.gyro - readings.bias) @ device.truth.matrix.T
    np.testing.assert_allclose(corrected, motion.rate, atol=1e-12)


@pytest.mark.parametrize("noise_dps", [0.03, 0.15])
def test_noise_is_as_asked_and_white(noise_dps: float) -> None:
    _, readings = read(replace(PERFECT, noise_dps=noise_dps), at_rest(200))
    noise = np.degrees(readings.gyro)
    assert noise.std(axis=0) == pytest.approx(noise_dps, rel=0.03)
    assert abs(np.corrcoef(noise[1:, 0], noise[:-1, 0])[0, 1]) < 0.03


def test_bias_walks_as_the_square_root_of_time() -> None:
    spec = replace(PERFECT, rrw_dps_per_sqrt_s=0.01)
    ends = [np.degrees(read(spec, at_rest(25), seed)[1].bias[-1]) for seed in range(200)]
    assert np.std(ends) == pytest.approx(0.01 * 5, rel=0.1)


def test_bias_follows_the_warm_up() -> None:
    spec = replace(PERFECT, bias_dps_per_kelvin=0.1, warm_up_s=10.0)
    device, readings = read(spec, at_rest(100))
    assert readings.temperature_c[0] == pytest.approx(25.0, abs=0.1)
    assert readings.temperature_c[-1] == pytest.approx(35.0, abs=0.1)
    warmed = readings.bias[-1] - device.truth.turn_on_bias
    np.testing.assert_allclose(warmed, device.truth.bias_per_kelvin * 10, rtol=1e-3)


def test_bias_instability_is_a_floor_of_the_allan_deviation() -> None:
    spec = replace(PERFECT, bias_instability_dps=0.02)
    time_s = np.arange(1, 10 * 7200 + 1) / 10
    motion = Motion([Still(1.0)]).advance(time_s)
    bias = np.degrees(np.hstack([read(spec, motion, seed)[1].bias for seed in range(2)]))
    tau_s = [2.0, 6.0, 20.0, 60.0, 200.0]
    floors = [allantools.oadev(axis, rate=10.0, data_type="freq", taus=tau_s)[1] for axis in bias.T]
    floor = np.sqrt(np.mean(np.square(floors), axis=0))
    assert floor == pytest.approx(np.full(5, 0.664 * 0.02), rel=0.15)
    slope = np.polyfit(np.log(tau_s), np.log(floor), 1)[0]
    assert abs(slope) < 0.06  # white noise would have -0.5, a random walk 0.5


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_turned_upside_down_g_sensitivity_shows_twice(axis: int) -> None:
    spec = replace(PERFECT, g_sensitivity_dps_per_g=0.2)
    force = np.zeros((2, 3))
    force[:, axis] = [9.80665, -9.80665]
    motion = TrueMotion(np.array([1.0, 2.0]), np.zeros((2, 3)), np.tile([1.0, 0, 0, 0], (2, 1)), force)
    device, readings = read(spec, motion)
    dps_per_g = np.degrees(device.truth.g_sensitivity[:, axis]) * 9.80665
    np.testing.assert_allclose(np.degrees(readings.gyro[0] - readings.gyro[1]) / 2, dps_per_g)
    assert 0 < np.abs(dps_per_g).max() <= 0.2


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_misaligned_axis_reads_a_share_of_the_others(axis: int) -> None:
    rate = np.radians(100.0) * np.eye(3)[[axis]]
    motion = TrueMotion(np.array([1.0]), rate, np.array([[1.0, 0, 0, 0]]), np.zeros((1, 3)))
    device, readings = read(replace(PERFECT, misalignment_deg=2.0), motion)
    across = np.delete(np.degrees(readings.gyro[0]), axis)
    assert (across != 0).all()
    # To first order a reading is -E of the rate.
    np.testing.assert_allclose(across, -100 * np.delete(device.truth.matrix[:, axis], axis), atol=0.3)
    assert np.abs(across).max() < 100 * np.radians(2.1)


def test_readings_saturate_at_the_range_and_fall_on_steps() -> None:
    _, clipped = read(replace(PERFECT, range_dps=60.0), truth())
    assert np.degrees(np.abs(clipped.gyro).max()) == pytest.approx(60.0)
    _, stepped = read(replace(ImuSpec(), step_dps=0.07), truth())
    steps = np.degrees(stepped.gyro) / 0.07
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)


def test_however_it_is_cut_it_reads_the_same() -> None:
    motion = truth()
    _, whole = read(DEMO_SPEC, motion)
    device = ImuErrorModel(DEMO_SPEC, np.random.default_rng(1))
    cuts = [0, 1, 2, 500, len(motion.time_s)]
    parts = [
        device.read(TrueMotion(motion.time_s[a:b], motion.rate[a:b], motion.attitude[a:b], motion.force[a:b]))
        for a, b in pairwise(cuts)
    ]
    np.testing.assert_allclose(np.concatenate([part.bias for part in parts]), whole.bias, atol=1e-12)
    # A rounding error may push a reading onto the next step.
    assert (np.abs(np.concatenate([part.gyro for part in parts]) - whole.gyro) > 1e-9).mean() < 1e-3
