"""`truerate allan` as people use it."""

import json
from pathlib import Path

import numpy as np
import pytest

from estimator.cli.main import main
from estimator.noise.device_model import load_model
from tests.estimator.stillness.rest import Floats, at_rest

RATE_HZ = 50.0


def lying(seconds: float, seed: int = 1) -> Floats:
    """Readings (n, 3) of an MPU-6050-like gyro on a table, rad/s."""
    n = int(seconds * RATE_HZ)
    rates = [at_rest(seed + axis, n, RATE_HZ, 0.01, 2e-3) + bias for axis, bias in enumerate((4.5, 0.05, -1.1))]
    return np.radians(np.round(np.column_stack(rates) * 131) / 131)


def saved(path: Path, gyro: Floats, **also: object) -> str:
    np.savez(path, **{"gyro_rad_s": gyro, "rate_hz": RATE_HZ, **also})  # type: ignore[arg-type]
    return str(path)


def carried(seconds: float, seed: int) -> Floats:
    """Readings (n, 3) of one that is carried about."""
    n = int(seconds * RATE_HZ)
    return np.cumsum(np.random.default_rng(seed).normal(0, 0.1, (n, 3)), axis=0)


def test_a_table_and_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gyro = np.concatenate([carried(10, 1), lying(600), carried(5, 2)])
    picture = tmp_path / "new" / "allan.png"
    file = saved(tmp_path / "rest.npz", gyro, temperature_c=np.linspace(24.0, 26.0, len(gyro)))
    assert main(["allan", file, "--picture", str(picture)]) == 0
    printed = capsys.readouterr().out
    for words in ("angle random walk", "bias instability", "<", "0.01", "of 615 s", "°C", "not seen", str(picture)):
        assert words in printed.replace("\n", " " if words.count(" ") else "\n")
    assert picture.stat().st_size > 10_000


def test_json_is_one_object_in_si(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    file = saved(tmp_path / "rest.npz", np.concatenate([carried(10, 1), lying(600)]))
    assert main(["allan", file, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert 10 <= found["used_s"][0] < 40
    assert found["used_s"][1] == pytest.approx(610, abs=1)
    assert found["rate_hz"] == pytest.approx(RATE_HZ)
    assert found["temperature_c"] is None
    assert np.degrees(found["step_rad_s"]) == pytest.approx(np.full(3, 1 / 131), rel=1e-6)
    for axis in "xyz":
        arw = found["axes"][axis]["arw"]
        assert arw["seen"]
        assert np.degrees(arw["value"]) == pytest.approx(0.01, rel=0.03)
        assert arw["low"] < arw["value"] < arw["high"]
    assert not (tmp_path / "out").exists()


def test_a_model_is_written_and_read_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "devices" / "mine.toml"
    words = ["allan", saved(tmp_path / "rest.npz", lying(120)), "--json", "--write", str(path), "--model", "mpu-6050"]
    assert main(words) == 0
    mine, kind = load_model(path), load_model("mpu-6050")
    assert mine.model == "mine"
    assert np.degrees(mine.arw) == pytest.approx(np.full(3, 0.01), rel=0.06)
    assert mine.turn_on_bias == pytest.approx(kind.turn_on_bias)
    assert "# measured" in path.read_text(encoding="utf-8")
    assert "mpu-6050's, or the upper limit" in path.read_text(encoding="utf-8")
    assert main(words) == 2
    assert "the file exists already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--write", "mine.json"], "ends in .toml"),
        (["--write", "mine.toml", "--model", "mpu6050"], "did you mean 'mpu-6050'"),
        (["--write", "/dev/null/mine.toml"], "/dev/null is not a folder"),
    ],
)
def test_wrong_use_is_said_before_the_work(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["allan", "nowhere.npz", *words]) == 2
    assert said in capsys.readouterr().err


def test_too_short_a_rest(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = saved(tmp_path / "short.npz", np.concatenate([lying(40), carried(100, 3)]))
    assert main(["allan", file]) == 1
    said = capsys.readouterr().err
    for words in ("short: its longest rest lasts 3", "of 140 s", "at least 55 s", "hour"):
        assert words in said


def test_times_of_arrival(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gyro = lying(100)
    bunched = np.arange(len(gyro)) / RATE_HZ
    bunched[1::2] -= 0.7 / RATE_HZ
    bunched += np.where(np.arange(len(gyro)) % 4 < 2, 0.0, -1.1 / RATE_HZ)
    assert main(["allan", saved(tmp_path / "usb.npz", gyro, t_s=np.sort(bunched))]) == 1
    assert "not evenly spaced" in capsys.readouterr().err


@pytest.mark.data
def test_a_real_mpu_6050(shared_data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = shared_data / "sunsided_mpu6050" / "unmoved-x-pointing-forward.npz"
    assert main(["allan", str(file), "--rate-hz", "100", "--json"]) == 0
    axes = json.loads(capsys.readouterr().out)["axes"]
    arw = [np.degrees(axes[axis]["arw"]["value"]) for axis in "xyz"]
    assert all(0.006 < value < 0.014 for value in arw)
    assert not any(axes[axis]["rrw"]["seen"] for axis in "xyz")
