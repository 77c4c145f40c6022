"""Real sensors: by how much gravity moves a gyro's bias, which no sheet of theirs tells and the tracker does not model."""

from pathlib import Path

import numpy as np
import pytest

from bridge.recording import load

pytestmark = pytest.mark.data
#: °/s per g, of an MPU-6050 by its sheet
_SHEET = 0.1


@pytest.mark.parametrize("name", ["mikoff_mpu9150/imu0.npz", "mikoff_mpu9150/imu3.npz", "imucal/ferraris_session.npz"])
def test_gravity_moves_a_bias_less_than_a_sheet_says(shared_data: Path, name: str) -> None:
    """By least squares over seconds of rest in many poses, with a drift evenly in time: the figures of docs/accuracy.md."""
    of = load(shared_data / name)
    assert of.accel is not None
    second = round(of.rate_hz)
    n = len(of) // second
    gyro, accel = (each[: n * second].reshape(n, second, 3) for each in (np.degrees(of.gyro), of.accel / 9.80665))
    moves = gyro.std(axis=1).max(axis=1)
    rests = (moves < 1.6 * np.percentile(moves, 10)) & (accel.std(axis=1).max(axis=1) < 0.02)
    pose, minutes = accel[rests].mean(axis=1), np.flatnonzero(rests) / 60
    seen = np.column_stack([np.ones(len(pose)), minutes, pose])
    assert len(pose) >= 40
    assert np.linalg.matrix_rank(seen) == 5, "poses all around"
    by_gravity = np.linalg.lstsq(seen, gyro[rests].mean(axis=1))[0][2:]
    assert 0.005 < np.abs(by_gravity).max() < 0.03 < _SHEET
