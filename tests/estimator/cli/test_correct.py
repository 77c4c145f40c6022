"""`truerate correct` as people use it: what it writes, what it says, and what it refuses."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.recording import load
from bridge.sim.calibration_session import Session, simulate_session
from estimator.cli.main import main
from estimator.offline import corrected_file
from estimator.offline.recordings import correct


@pytest.fixture(scope="module")
def session() -> Session:
    return simulate_session(4)


@pytest.fixture
def recorded(session: Session, tmp_path: Path) -> Path:
    path = tmp_path / "day.npz"
    np.savez(
        path, gyro_rad_s=session.gyro, accel_m_s2=session.accel, temperature_c=session.temperature_c, t_s=session.time_s
    )
    return path


def test_it_writes_a_row_for_each_sample(session: Session, recorded: Path, tmp_path: Path) -> None:
    out = tmp_path / "corrected.npz"
    assert main(["correct", str(recorded), str(out)]) == 0
    expected = correct(load(recorded))
    with np.load(out, allow_pickle=False) as file:
        assert set(file.files) == {
            "t_s", "rate_rad_s", "rate_std_rad_s", "bias_rad_s", "bias_std_rad_s", "quality", "quality_names", "matrix",
            "rate_hz", "accel_m_s2", "temperature_c", "quat_wxyz", "tilt_std", "heading_std",
        }  # fmt: skip
        for name in ("rate", "rate_std", "bias", "bias_std"):
            assert file[f"{name}_rad_s"].shape == (len(session.gyro), 3)
            np.testing.assert_array_equal(file[f"{name}_rad_s"], getattr(expected, name))
        np.testing.assert_array_equal(file["quality"], expected.quality)
        assert file["quality_names"][file["quality"][-1]] == "GOOD"
        np.testing.assert_allclose(np.diag(file["matrix"]), session.truth.k, atol=3e-4)
        np.testing.assert_array_equal(file["accel_m_s2"], session.accel)
        np.testing.assert_array_equal(file["temperature_c"], session.temperature_c)
        np.testing.assert_allclose(file["t_s"], session.time_s - session.time_s[0])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["corrected.npz", "day.npz"]


def test_where_gravity_taught_nothing_that_is_said(
    session: Session, recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["correct", str(recorded), str(tmp_path / "a.npz"), "--learn-matrix"]) == 0
    assert "gravity gave no scale or misalignment more certain" in capsys.readouterr().out
    np.savez(blind := tmp_path / "blind.npz", gyro_rad_s=session.gyro, t_s=session.time_s)
    assert main(["correct", str(blind), str(tmp_path / "b.npz"), "--learn-matrix"]) == 0
    assert "the recording has no accelerometer" in capsys.readouterr().out
    assert main(["correct", str(blind), str(tmp_path / "c.npz")]) == 0
    assert "gravity gave" not in capsys.readouterr().out


def test_it_is_on_the_disk_before_it_has_its_name(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, named = tmp_path / "corrected.npz", list[bool]()
    monkeypatch.setattr("os.fsync", lambda _: named.append(out.exists()))
    assert main(["correct", str(recorded), str(out)]) == 0
    assert not named[0]


def test_csv_holds_the_same_numbers(recorded: Path, tmp_path: Path) -> None:
    for name in ("c.npz", "c.csv"):
        assert main(["correct", str(recorded), str(tmp_path / name)]) == 0
    header, *rows = [line.split(",") for line in (tmp_path / "c.csv").read_text(encoding="utf-8").splitlines()]
    assert header[:4] == ["t_s", "rate_x_rad_s", "rate_y_rad_s", "rate_z_rad_s"]
    assert header[-4:] == ["accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2", "temperature_c"]
    assert header[-11:-4] == ["quality", "quat_w", "quat_x", "quat_y", "quat_z", "tilt_std", "heading_std"]
    with np.load(tmp_path / "c.npz") as file:
        assert [row[header.index("quality")] for row in rows] == file["quality_names"][file["quality"]].tolist()
        for vector in ("rate", "rate_std", "bias", "bias_std"):
            at = header.index(f"{vector}_x_rad_s")
            columns = np.array([row[at : at + 3] for row in rows], np.float32)
            np.testing.assert_array_equal(columns, file[f"{vector}_rad_s"])
        at = header.index("quat_w")
        turned = np.array([row[at : at + 6] for row in rows], np.float32)
        np.testing.assert_array_equal(turned[:, :4], file["quat_wxyz"])
        np.testing.assert_array_equal(turned[:, 4], file["tilt_std"])
        np.testing.assert_array_equal(turned[:, 5], file["heading_std"])
        np.testing.assert_allclose([float(row[0]) for row in rows], file["t_s"], atol=6e-7)
        np.testing.assert_allclose([float(row[-1]) for row in rows], file["temperature_c"], rtol=1e-8)


def test_it_says_in_words_what_became_of_it(recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["correct", "--realtime", str(recorded), str(tmp_path / "c.npz")]) == 0
    printed, err = capsys.readouterr()
    recording = load(recorded)
    assert f"{len(recording)} samples" in printed
    assert "as in a live ward" in printed
    assert "GOOD" in printed
    assert "TURNING -> TRACKING: The device is calibrated. The closure error of the three turns is" in printed
    assert "temperature: 25.0 to" in printed
    assert f"written: {tmp_path / 'c.npz'}" in printed
    assert err == "", "no bar where there is no terminal"


def test_json_for_machines(
    session: Session, recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["correct", str(recorded), str(tmp_path / "c.npz"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["samples"] == len(session.gyro)
    assert sum(found["seconds_by_quality"].values()) == pytest.approx(len(session.gyro) / 104.0, rel=1e-3)
    assert found["bias_rad_s"] == pytest.approx(list(session.bias[-1]), abs=np.radians(0.02))
    assert found["calibration"] == "day"
    assert found["written"].endswith("c.npz")


def test_a_calibration_goes_from_one_verb_to_the_other(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["calibrate", str(recorded), "--json"]) == 0
    kept = tmp_path / "chest.json"
    kept.write_text(capsys.readouterr().out, encoding="utf-8")
    words = ["correct", str(recorded), str(tmp_path / "c.npz"), "--calibration", str(kept)]
    assert main([*words, "--json"]) == 0
    seconds = json.loads(capsys.readouterr().out)["seconds_by_quality"]
    assert set(seconds) == {"DEGRADED", "GOOD"}, "the scale is used at once, the bias doubted until a rest"
    assert seconds["DEGRADED"] < 5.0
    assert main([*words, "--json", "--other-boot"]) == 0
    assert "PRIOR" in json.loads(capsys.readouterr().out)["seconds_by_quality"]


def test_smoothed_is_said_to_be(recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["correct", "--smooth", str(recorded), str(tmp_path / "c.npz")]) == 0
    assert "smoothed" in capsys.readouterr().out


@pytest.mark.parametrize("warm", [True, False])
def test_a_picture(session: Session, recorded: Path, tmp_path: Path, warm: bool) -> None:
    if not warm:
        np.savez(recorded, gyro_rad_s=session.gyro[:700], rate_hz=104.0)
    picture = tmp_path / "new" / "day.png"
    for _ in range(2):  # a picture takes a picture's place
        assert main(["correct", str(recorded), str(tmp_path / "c.npz"), "--picture", str(picture)]) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert picture.stat().st_size > 20_000


@pytest.mark.parametrize("kind", ["npz", "csv"])
def test_only_what_it_wrote_before_is_replaced(
    session: Session, recorded: Path, tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / f"out.{kind}"
    for _ in range(2):
        assert main(["correct", str(recorded), str(out)]) == 0
    other = tmp_path / f"other.{kind}"
    if kind == "npz":
        np.savez(other, gyro_rad_s=session.gyro, rate_hz=104.0)
    else:
        other.write_text("t_s,gx_dps,gy_dps,gz_dps\n0,1,2,3\n")
    before = other.read_bytes()
    assert main(["correct", str(recorded), str(other)]) == 1
    assert "is not a corrected recording; give another name" in capsys.readouterr().err
    assert other.read_bytes() == before


def test_a_recording_without_rests_says_that_nothing_is_corrected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    time_s = np.arange(3000) / 100
    gyro = np.sin(np.pi * time_s[:, None] + np.arange(3)) * 1.5
    np.savez(tmp_path / "day.npz", gyro_rad_s=gyro, t_s=time_s)
    assert main(["correct", str(tmp_path / "day.npz"), str(tmp_path / "out.npz")]) == 1
    said = capsys.readouterr().out
    assert "The bias is not corrected" in said
    assert "Record again" in said


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["IN", "IN"], 1, "never overwritten"),
        (["IN", "./sub/../day.npz"], 1, "never overwritten"),
        (["IN", "out.txt"], 1, "ends in .npz, .csv, .h5, .parquet, not in '.txt'"),
        (["IN", "out"], 1, "not in ''"),
        (["IN", "nowhere/out.npz"], 1, "there is no folder"),
        (["IN", "folder.npz"], 1, "is a folder"),
        (["IN", "pipe.npz"], 1, "is not a file"),
        (["missing.npz", "out.npz"], 1, "cannot be read"),
        (["IN", "out.npz", "--calibration", "missing.json"], 1, "missing.json: cannot be read"),
        (["IN", "out.npz", "--calibration", "IN"], 1, "not a calibration"),
        (["IN", "out.npz", "--other-boot"], 2, "add --calibration FILE"),
        (["IN", "out.npz", "--range-dps", "nan"], 2, "--range-dps is nan"),
        (["IN", "out.npz", "--range-dps", "5"], 1, "more than twice the range given, 5 °/s"),
        (["IN", "out.npz", "--picture", "p.xyz"], 2, "--picture p.xyz"),
        (["IN", "out.npz", "--picture", "out.npz/p.png"], 2, "out.npz is the output file, not a folder"),
    ],
)
def test_wrong_use_is_one_line(
    words: list[str],
    code: int,
    said: str,
    recorded: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.npz").mkdir()
    os.mkfifo(tmp_path / "pipe.npz")
    (tmp_path / "sub").mkdir()
    before = recorded.read_bytes()
    assert main(["correct", *(str(recorded) if word == "IN" else word for word in words)]) == code
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert recorded.read_bytes() == before
    assert not list(tmp_path.glob("out*"))


def saved(arrays: dict[str, NDArray[np.float64]]) -> None:
    np.savez("in.npz", allow_pickle=False, **arrays)


def test_readings_in_other_units_are_refused_or_not_used(
    session: Session,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.chdir(tmp_path)
    right = {"gyro_rad_s": session.gyro, "accel_m_s2": session.accel, "t_s": session.time_s}
    for wrong, said in (
        ({"gyro_rad_s": np.degrees(session.gyro)}, "are probably degrees per second, given as rad/s"),
        ({"t_s": session.time_s * 1e3}, "Give the right --time-unit (ms"),
        ({"t_s": session.time_s * 1e6}, "Give the right --time-unit (ms, us"),
        ({"t_s": session.time_s * 1e-3}, "Give the right --time-unit"),
    ):
        saved({**right, **wrong})
        for verb in (["correct", "in.npz", "out.npz"], ["calibrate", "in.npz"]):
            assert main(verb) == 1
            assert said in capsys.readouterr().err
        assert not Path("out.npz").exists()
    for scale, unit in ((1 / 9.80665, "g"), (1e3 / 9.80665, "mg")):
        saved({**right, "accel_m_s2": session.accel * scale})
        for verb in (["correct", "in.npz", "out.npz"], ["calibrate", "in.npz"]):
            assert main(verb) == 0
            assert f"The unit is probably {unit}, not m/s²; then give --accel-unit {unit}" in caplog.text
            caplog.clear()
        with np.load("out.npz") as file:
            assert "accel_m_s2" not in file


def test_what_fails_half_way_leaves_the_old_file(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "c.npz"
    out.write_bytes(b"old")

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(corrected_file.np, "savez", full)  # type: ignore[attr-defined] # where it is called
    assert main(["correct", str(recorded), str(out)]) == 1
    assert out.read_bytes() == b"old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c.npz", "day.npz"]
