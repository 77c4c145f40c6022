"""Device models: those that come with truerate, those of one's own, and what is said of a wrong one."""

from dataclasses import fields, replace
from math import radians
from pathlib import Path

import numpy as np
import pytest

from bridge.toml.loader import ConfigError
from estimator.config.device_settings import knobs_of, knobs_of_stated
from estimator.noise.device_model import GENERIC, NoiseModel, as_toml, load_model, model_stated, shipped


def test_every_file_is_a_model_of_its_name() -> None:
    assert sorted(shipped()) == ["factory-calibrated", "generic", "icm-20948", "lsm9ds1", "mpu-6050", "mpu-9150"]
    for name, path in shipped().items():
        assert load_model(name).model == path.stem == name


def test_degrees_become_radians() -> None:
    model = load_model("icm-20948")
    assert model.arw == pytest.approx(np.full(3, radians(0.015)))
    assert model.gyro_range == pytest.approx(radians(250))
    assert model.bias_per_kelvin == pytest.approx(radians(0.05))
    assert model.accel_noise == pytest.approx(230e-6 * 9.80665)


def same(one: NoiseModel, other: NoiseModel) -> bool:
    pairs = ((getattr(one, f.name), getattr(other, f.name)) for f in fields(NoiseModel) if f.name != "model")
    return all(theirs is None if ours is None else ours == pytest.approx(theirs, rel=1e-3) for ours, theirs in pairs)


@pytest.mark.parametrize("name", sorted(shipped()))
def test_what_is_written_reads_back(name: str, tmp_path: Path) -> None:
    path = tmp_path / "copy.toml"
    path.write_text(as_toml(load_model(name), {"arw": "measured"}, "One line.\nAnd another."), encoding="utf-8")
    assert path.read_text(encoding="utf-8").startswith("# One line.\n# And another.\n")
    assert "  # measured\n" in path.read_text(encoding="utf-8")
    assert same(load_model(path), load_model(name))


def changed(tmp_path: Path, old: str, new: str) -> Path:
    text = shipped()[GENERIC].read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "changed.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("rrw_dps_per_sqrt_s", "rrw_dps_sqrt_s", ["[gyro]", "'rrw_dps_sqrt_s'", "'rrw_dps_per_sqrt_s'"]),
        ("range_dps = 2000\n", "", ["[gyro]", "'range_dps' is missing"]),
        ("= 0.015", '= "little"', ["[gyro]", "'arw_dps_per_sqrt_hz'"]),
        ("= 0.015", "= [0.01, 0.02]", ["[gyro]", "'arw_dps_per_sqrt_hz'"]),
        ("= 0.015", "= 0", ["[gyro]", "arw_dps_per_sqrt_hz is 0: use a number above 0"]),
        ("= 0.0007", "= -1", ["[gyro]", "rrw_dps_per_sqrt_s is -1: use a number above 0"]),
        ("= 0.05 ", "= nan ", ["[gyro]", "bias_dps_per_kelvin is nan"]),
        ('"generic"', '"two\\nlines"', ["model is", "give a printable name"]),
        ("zero_g_mg", "zero_g", ["[accel]", "'zero_g'", "'zero_g_mg'"]),
    ],
)
def test_a_wrong_file_is_refused_with_table_and_key(old: str, new: str, words: list[str], tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as refused:
        load_model(changed(tmp_path, old, new))
    for word in ("changed.toml", *words):
        assert word in str(refused.value)


def test_an_unknown_name_is_answered_with_the_nearest() -> None:
    with pytest.raises(ConfigError, match="'mpu6050'; did you mean 'mpu-6050'"):
        load_model("mpu6050")


def test_the_flat_of_the_allan_deviation_counts_where_it_is_more_than_the_walk() -> None:
    generic = load_model(GENERIC)
    walk = knobs_of(generic).track.bias.rate_random_walk
    assert walk == pytest.approx(float(generic.rrw.max())), "models that come with truerate: their walk covers it"
    quiet = replace(generic, rrw=generic.rrw / 10)
    flat = knobs_of(quiet).track.bias.rate_random_walk
    assert flat * np.sqrt(1000.0 / 3) == pytest.approx(0.664 * float(generic.bias_instability.max()))
    assert float(quiet.rrw.max()) < flat < walk


def test_by_how_much_a_bias_flickers() -> None:
    """By an integral over the spectrum that IEEE Std 952 gives, 0.001 to 1 Hz."""
    worst = load_model("lsm9ds1")
    f = np.geomspace(0.001, 1.0, 10_000)
    var = np.trapezoid(2 * float(worst.bias_instability.max()) ** 2 / (2 * np.pi * f), f)
    assert knobs_of(worst).track.bias.flicker == pytest.approx(np.sqrt(var), rel=0.001)


@pytest.mark.parametrize(
    ("words", "name"),
    [
        ("Arduino Nano 33 BLE (LSM9DS1)", "lsm9ds1"),
        ("OpenLog Artemis (ICM-20948)", "icm-20948"),
        ("my sketch, MPU6050", "mpu-6050"),
        ("MTi-3-8A7G6", "factory-calibrated"),
        ("Movella DOT XS-T01", "factory-calibrated"),
        ("x-IMU3 6D1F-0B3A", "factory-calibrated"),
        ("Shimmer3", ""),  # it may hold no calibration of its own
        ("WitMotion", ""),
        ("anMTi, 7LSM9DS12", ""),
        ("", ""),
    ],
)
def test_the_model_is_found_in_what_a_device_says_it_is(words: str, name: str) -> None:
    assert model_stated(words) == name


def test_a_stated_model_gives_noise_and_bias_but_refuses_no_turn_of_its_own_accord() -> None:
    stated, usual, told = knobs_of_stated("Xsens MT"), knobs_of_stated(""), knobs_of(load_model("factory-calibrated"))
    assert (stated.prior.bias_std, stated.track) == (told.prior.bias_std, told.track)
    assert (stated.scale_limit, stated.gyro_range) == (usual.scale_limit, usual.gyro_range)
    assert usual.scale_limit > told.scale_limit
