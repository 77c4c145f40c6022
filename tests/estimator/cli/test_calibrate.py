"""`truerate calibrate FILE` as people use it: what it prints, what it says of mistakes, and its exit codes."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.sim.calibration_session import Session, simulate_session
from bridge.sim.imu_errors import ImuSpec
from bridge.sim.motion_scripts import TurnPlan
from estimator.cli.main import main
from tests.estimator.calibration.machines import on_a_turntable
from tests.estimator.calibration.sessions import in_poses

Floats = NDArray[np.float64]


def save(path: Path, session: Session, gyro: Floats | None = None) -> str:
    np.savez(path, gyro_rad_s=session.gyro if gyro is None else gyro, accel_m_s2=session.accel, rate_hz=session.rate_hz)
    return str(path)


def test_calibrate_prints_one_json_object(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session = simulate_session(4)
    assert main(["calibrate", save(tmp_path / "good.npz", session), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["verdict"] == "accepted"
    assert np.array(found["matrix"]).shape == (3, 3)
    assert np.diag(found["matrix"]) == pytest.approx(session.truth.k, abs=2e-4)
    assert found["bias_rad_s"] == pytest.approx(list(session.bias[0]), abs=np.radians(0.01))
    assert np.array(found["covariance"]).shape == (len(found["parameters"]),) * 2
    assert found["method"]
    # A scale known to 0.15 before and to 8e-5 after, of a device put back exactly: eleven halvings.
    assert found["information_bits"]["k_x"] == pytest.approx(11, abs=1.5)
    assert found["reason"]
    assert sorted(turn["axis"] for turn in found["turns"]) == ["x", "y", "z"]
    assert {"axis", "angle_deg", "closure_error_deg", "duration_s"} == set(found["turns"][0])


def test_an_assumed_rate_is_repeated_in_the_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session = simulate_session(4)
    table = np.column_stack([np.degrees(session.gyro), session.accel])
    file = tmp_path / "no-times.csv"
    np.savetxt(file, table, delimiter=",", header="gx_dps,gy_dps,gz_dps,ax_m_s2,ay_m_s2,az_m_s2", comments="")
    words = ["calibrate", str(file), "--rate-hz", f"{session.rate_hz:g}"]
    assert main(words) == 0
    assert f"note: there are no sample times: the given {session.rate_hz:g} Hz is assumed" in capsys.readouterr().out
    assert main([*words, "--json"]) == 0
    assert any("is assumed" in note for note in json.loads(capsys.readouterr().out)["notes"])


@pytest.mark.parametrize("method", ["closure", "turn360"])
def test_calibrate_by_a_method(method: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", save(tmp_path / "good.npz", simulate_session(4)), "--method", method]) == 0
    printed = capsys.readouterr().out
    assert f"accepted ({method})" in printed
    assert "closed to °" in printed


def test_calibrate_by_poses_prints_the_whole_matrix(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    of = in_poses(2)
    file = str(tmp_path / "poses.npz")
    np.savez(file, gyro_rad_s=of.gyro, accel_m_s2=of.accel, t_s=of.time)
    assert main(["calibrate", file, "--method", "transitions"]) == 0
    printed = capsys.readouterr().out
    assert "of reading z" in printed
    assert "closed to" not in printed  # there are no turns of which that could be said
    assert f"{of.truth.matrix[0, 1]:+.3f}"[:5] in printed
    assert main(["calibrate", file, "--method", "transitions", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["parameters"][:7] == ["bias_x", "bias_y", "bias_z", "k_x", "k_y", "k_z", "m_xy"]
    assert np.array(found["covariance"]).shape == (12, 12)


def test_calibrate_on_a_turntable(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    of = on_a_turntable(1)
    file = str(tmp_path / "table.npz")
    np.savez(file, gyro_rad_s=of.gyro, t_s=of.time)
    assert main(["calibrate", file, "--method", "turntable", "--rates-dps", "30,60,90"]) == 0
    assert "accepted (turntable)" in capsys.readouterr().out


def test_a_turn_that_was_not_once_around_is_asked_for_again_where_the_kind_of_device_is_known(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """About the vertical nothing else shows it; live it is the same (session/test_life.py)."""
    short = simulate_session(4, turns=(TurnPlan(0), TurnPlan(1), TurnPlan(2, 330.0)), spec=ImuSpec(scale=(1.0, 1.0)))
    file = save(tmp_path / "short.npz", short)
    assert main(["calibrate", file, "--model", "mpu-6050"]) == 1
    assert "Turn the device about z once round." in capsys.readouterr().out
    whole = simulate_session(4, spec=ImuSpec(scale=(0.97, 1.03)))
    assert main(["calibrate", save(tmp_path / "whole.npz", whole), "--model", "mpu-6050"]) == 0


@pytest.mark.parametrize("rates", ["thirty", "30,-60", "0", "nan"])
def test_rates_are_numbers(rates: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["calibrate", "nowhere.npz", "--method", "turntable", f"--rates-dps={rates}"])
    assert rates in capsys.readouterr().err


def a_missing_turn() -> tuple[Session, Floats | None]:
    return simulate_session(4, turns=(TurnPlan(0), TurnPlan(2))), None


def a_turn_that_does_not_close() -> tuple[Session, Floats | None]:
    return simulate_session(4, replacement_deg=12.0), None


def half_a_turn() -> tuple[Session, Floats | None]:
    return simulate_session(4, turns=(TurnPlan(0), TurnPlan(1, 180.0), TurnPlan(2))), None


def clipped_rates() -> tuple[Session, Floats | None]:
    session = simulate_session(4)
    limit = np.radians(60.0)
    return session, np.clip(session.gyro, -limit, limit)


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (a_missing_turn, "No full turn about y"),
        (half_a_turn, "not a full turn"),
        (a_turn_that_does_not_close, "tilted"),
        (clipped_rates, "too fast for the gyro's range"),
    ],
)
def test_a_bad_session_is_not_accepted_and_says_why(
    bad: object, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert callable(bad)
    session, gyro = bad()
    path = save(tmp_path / "bad.npz", session, gyro)
    assert main(["calibrate", path, "--json", "--range-dps", "60" if gyro is not None else "0"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["verdict"] in ("repeat", "refused")
    assert words in " ".join(one["text"] for one in found["reason"])


def test_samples_without_a_rate_are_left_out_and_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    session = simulate_session(4)
    gyro = session.gyro.copy()
    gyro[123, 1] = np.nan
    assert main(["calibrate", save(tmp_path / "nan.npz", session, gyro)]) == 0
    assert "1 row left out: a rate is missing" in caplog.text
    gyro[123:] = np.nan
    assert main(["calibrate", save(tmp_path / "many.npz", session, gyro)]) == 1
    assert "sample 123" in capsys.readouterr().err


@pytest.mark.parametrize("dps", ["-3", "nan", "1e6"])
def test_a_range_that_no_gyro_has_is_refused(dps: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", save(tmp_path / "good.npz", simulate_session(4)), "--range-dps", dps]) == 2
    assert "give 0 (unknown) to 10000" in capsys.readouterr().err
