"""A calibration goes into a file and comes back; what is no calibration is refused with what came and what to do."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge.recording import Recording
from bridge.sim.calibration_session import simulate_session
from estimator.calibration.gravity_propagation import MATRIX_PARAMETERS
from estimator.offline import calibration_file
from estimator.offline.calibration_file import CalibrationFileError, of_result
from estimator.offline.recordings import calibrate
from tests.estimator.device.test_correction import CALIBRATION
from tests.sentences import free

KNOWN = replace(
    CALIBRATION, device="", boot=0, time_ns=0, rate_hz=104.0, gyro_range=8.7, reason=free("three turns closed")
)
Json = dict[str, Any]


def written(tmp_path: Path, change: Callable[[Json], object] = lambda _: None) -> Path:
    path = tmp_path / "chest.json"
    file = json.loads(json.dumps(calibration_file.as_json(KNOWN)))
    change(file)
    path.write_text(json.dumps(file), encoding="utf-8")
    return path


def put(**values: object) -> Callable[[Json], object]:
    return lambda file: file.update(values)


def test_what_was_saved_is_loaded(tmp_path: Path) -> None:
    of = simulate_session(4)
    recording = Recording(of.time_s, of.gyro, of.accel, of.temperature_c, of.rate_hz, "session", device="chest", boot=7)
    result, _ = calibrate(recording)
    saved = calibration_file.as_json(of_result(result, recording, gyro_range=8.7))
    (tmp_path / "chest.json").write_text(json.dumps(saved), encoding="utf-8")
    loaded = calibration_file.load(tmp_path / "chest.json")
    again = calibration_file.as_json(loaded)
    for turn, back in zip(saved.pop("turns"), again.pop("turns"), strict=True):
        assert turn.pop("axis") == back.pop("axis")
        assert turn == pytest.approx(back, rel=1e-12)
    assert again == saved
    assert len(loaded.turns) == 3
    assert 25.0 < loaded.temperature_c < 35.0


def test_a_full_matrix_and_unknown_keys_pass(tmp_path: Path) -> None:
    n = len(MATRIX_PARAMETERS)
    full = replace(KNOWN, parameters=MATRIX_PARAMETERS, covariance=1e-6 * np.eye(n), temperature_c=float("nan"))
    file = {**calibration_file.as_json(full), "something of next year": 1}
    (tmp_path / "full.json").write_text(json.dumps(file), encoding="utf-8")
    loaded = calibration_file.load(tmp_path / "full.json")
    assert loaded.parameters == MATRIX_PARAMETERS
    assert np.isnan(loaded.temperature_c)


def swapped(file: Json) -> None:
    file["covariance"][0][1] = 1e-8


def impossible(file: Json) -> None:
    file["covariance"][0][1] = file["covariance"][1][0] = 3e-8


def without(name: str) -> Callable[[Json], object]:
    return lambda file: file.pop(name)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (put(format="other"), "the format is 'other'"),
        (put(version=2), "version 2; 'truerate calibration', version 1, is expected"),
        (
            put(verdict="repeat", reason=[{"code": "turns_undetermined"}]),
            "verdict is 'repeat', not 'accepted' (The turns do not determine",
        ),
        (put(matrix=None), "no estimate"),
        (put(matrix=[[1, 0], [0, 1]]), "not a calibration"),
        (put(matrix="one"), "`$.matrix`"),
        (put(matrix=[[1, 0, 0], [0, 0.1, 0], [0, 0, 1]]), "0.1"),
        (put(matrix=[[1, 0, 0], [0.5, 1, 0], [0, 0, 1]]), "outside its diagonal"),
        (put(bias_rad_s=[0, 0, 4.5]), "bias_rad_s is [0.0, 0.0, 4.5]; allowed: -1 to 1"),
        (put(bias_rad_s=[0, None, 0]), "$.bias_rad_s"),
        (put(bias_rad_s=[0, 0, 0.9], gyro_range_rad_s=0.5), "bias_rad_s is [0.0, 0.0, 0.9]; allowed: -0.5 to 0.5"),
        (put(noise_std_rad_s=[0.1, -0.1, 0.1]), "noise_std_rad_s"),
        (put(noise_std_rad_s=[0.001, 0.0, 0.001]), "noise_std_rad_s is [0.001, 0.0, 0.001]; allowed: 1e-06 to 0.1"),
        (put(noise_std_rad_s=[0.001, 3.0, 0.001]), "noise_std_rad_s is [0.001, 3.0, 0.001]; allowed: 1e-06 to 0.1"),
        (
            put(covariance=np.eye(6).tolist()),
            "gives bias_rad_s the standard deviation 1; at most",
        ),
        (put(covariance=np.diag([1e-6] * 3 + [1.0] * 3).tolist()), "gives k the standard deviation 1"),
        (put(parameters=["k_x", "k_y", "k_z", "bias_x", "bias_y", "bias_z"]), "'parameters' are k_x"),
        (put(parameters=[*KNOWN.parameters, "m_xx"]), "m_xx"),
        (put(covariance=[[1.0]]), "6 × 6"),
        (put(covariance=np.zeros((6, 6)).tolist()), "not above 0"),
        (put(covariance=np.diag([5e-324] + [1e-6] * 5).tolist()), "the standard deviation 2.22e-162; at least 1e-09"),
        (swapped, "not symmetric"),
        (impossible, "eigenvalue below 0"),
        (put(temperature_c=5000), "temperature_c"),
        (put(rate_hz=-1), "rate_hz"),
        (put(turns=[{"axis": "w", "angle_deg": 1, "closure_error_deg": 0, "duration_s": 1}]), "'w'"),
        (without("covariance"), "covariance"),
    ],
)
def test_what_is_no_calibration_is_refused(change: Callable[[Json], object], words: str, tmp_path: Path) -> None:
    path = written(tmp_path, change)
    with pytest.raises(CalibrationFileError) as refused:
        calibration_file.load(path)
    assert str(refused.value).startswith(f"{path}: ")
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "not a calibration"),
        (b"{", "not a calibration"),
        (b"\xff\xfe", "not a calibration"),
        (b"[1]", "Expected `object`"),
        (b'{"matrix": NaN}', "not a calibration"),
        (b"[" * 100_000, "not a calibration"),
        (b" " * (2 << 20), "2097152 bytes, more than 1048576"),
    ],
)
def test_bytes_that_are_none(data: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "chest.json"
    path.write_bytes(data)
    with pytest.raises(CalibrationFileError, match=words):
        calibration_file.load(path)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(CalibrationFileError, match="No such file"):
        calibration_file.load(tmp_path / "nowhere.json")
