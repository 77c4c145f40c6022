"""`import truerate`: what it gives, and what a program does with it; the simulator knows the truth."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import truerate
from numpy.typing import NDArray

from bridge.recording import RecordingError
from bridge.sim.calibration_session import Session, simulate_session


@pytest.fixture(scope="module")
def session() -> Session:
    return simulate_session(7)


def test_it_promises_these_names_and_each_is_documented() -> None:
    assert truerate.__all__ == ["Client", "Recording", "calibrate", "correct", "explain", "load"]
    assert all(getattr(truerate, name).__doc__ for name in truerate.__all__)


def test_an_installed_truerate_is_imported_from_anywhere(tmp_path: Path) -> None:
    code = "import truerate, sys; print(sorted(truerate.__all__))"
    words = [sys.executable, "-c", code]
    said = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    assert said.strip() == str(sorted(truerate.__all__))


def test_arrays_are_calibrated_and_corrected(session: Session) -> None:
    recording = truerate.Recording.from_arrays(session.gyro, session.accel, session.rate_hz)
    result, _ = truerate.calibrate(recording)
    assert result.verdict.name == "ACCEPTED"
    assert truerate.explain(result.reason).startswith("The closure error of the three turns is ")
    np.testing.assert_allclose(result.scale, np.diag(session.truth.matrix), rtol=1e-3)
    np.testing.assert_allclose(result.bias, session.bias[-1], atol=np.radians(0.1))
    corrected = truerate.correct(recording, result)
    rest = slice(*session.stages[-1])
    assert np.abs(corrected.rate[rest].mean(axis=0)).max() < np.radians(0.05)
    assert corrected.rate.shape == corrected.rate_std.shape == session.gyro.shape


def test_arrays_need_no_accelerometer_and_are_copied(session: Session) -> None:
    gyro = session.gyro.copy()
    recording = truerate.Recording.from_arrays(gyro, None, session.rate_hz)
    gyro[:] = 0.0
    assert recording.accel is None
    np.testing.assert_array_equal(recording.gyro, session.gyro)
    np.testing.assert_allclose(np.diff(recording.time_s), 1 / session.rate_hz)


@pytest.mark.parametrize(
    ("gyro", "accel", "rate_hz", "words"),
    [
        (np.zeros((5, 2)), None, 100.0, r"gyro has shape \(5, 2\); give \(n, 3\)"),
        (np.zeros((1, 3)), None, 100.0, "1 sample; at least 2 are needed"),
        (np.full((5, 3), np.nan), None, 100.0, "gyro is not finite at sample 0"),
        (np.full((5, 3), 2000.0), None, 100.0, "gyro is 2000 rad/s at sample 0.*degrees per second"),
        (np.zeros((5, 3)), np.zeros((4, 3)), 100.0, r"accel has shape \(4, 3\); give \(5, 3\)"),
        (np.zeros((5, 3)), None, -5.0, "rate_hz is -5"),
    ],
)
def test_what_cannot_be_a_recording_is_refused(
    gyro: NDArray[np.float64], accel: NDArray[np.float64] | None, rate_hz: float, words: str
) -> None:
    with pytest.raises(RecordingError, match=words):
        truerate.Recording.from_arrays(gyro, accel, rate_hz)


def test_a_file_is_loaded(session: Session, tmp_path: Path) -> None:
    path = tmp_path / "session.npz"
    np.savez(path, gyro_rad_s=session.gyro, rate_hz=session.rate_hz)
    np.testing.assert_array_equal(truerate.load(path).gyro, session.gyro)
