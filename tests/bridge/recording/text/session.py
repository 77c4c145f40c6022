"""A session of three turns, simulated without any of truerate's code, and written as tools write it."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.recording import Reading, RecordingError, load
from estimator.offline.recordings import calibrate

Floats = NDArray[np.float64]
K, BIAS_DPS, G = np.array([1.03, 0.98, 1.01]), np.array([0.8, -1.2, 0.5]), 9.80665


def turns(hz: float = 50.0, seed: int = 0) -> tuple[Floats, Floats, Floats]:
    """time (n,) s, rates (n, 3) °/s, acceleration (n, 3) g: rests of 3 s, a turn of 4 s about each axis."""
    random = np.random.default_rng(seed)
    n, m = round(3.2 * hz), round(4 * hz)
    rate = [np.zeros((n, 3))]
    for axis in range(3):
        turn = np.zeros((m, 3))
        shape = np.sin(np.pi * (np.arange(m) + 0.5) / m) ** 2
        turn[:, axis] = 360 * shape / shape.sum() * hz
        rate += [turn, np.zeros((n, 3))]
    true = np.concatenate(rate)
    accel = np.zeros_like(true)
    up = np.array([0.0, 0.0, 1.0])
    for at, now in enumerate(true):
        accel[at] = up
        angle = np.radians(now) / hz
        up = up - np.cross(angle, up)
        up = up / np.linalg.norm(up)
    gyro = true / K + BIAS_DPS + random.normal(0, 0.04, true.shape)
    return np.arange(len(true)) / hz, gyro, accel + random.normal(0, 0.003, true.shape)


TIME, GYRO_DPS, _ACCEL = turns()
ACCEL_MS2 = _ACCEL * G


def table(columns: Iterable[Floats], separator: str = ",", form: str = "%.6f") -> list[str]:
    """Rows of text."""
    return [separator.join(form % value for value in row) for row in np.column_stack(list(columns))]


def right(path: Path, reading: Reading | None = None) -> str:
    """Calibrates a file; asserts k within 0.005 and bias within 0.05 °/s; returns what was said of it."""
    recording = load(path, reading=reading or Reading())
    result, passed_over = calibrate(recording)
    assert result.verdict.name == "ACCEPTED", (result.reason, passed_over, recording.notes)
    assert np.allclose(result.scale, K, atol=0.005), (result.scale, recording.notes)
    assert np.allclose(np.degrees(result.bias), BIAS_DPS, atol=0.05), recording.notes
    return "; ".join(recording.notes)


def refusal(path: Path, reading: Reading | None = None) -> str:
    """Why a file is not read."""
    with pytest.raises(RecordingError) as refused:
        load(path, reading=reading or Reading())
    assert str(refused.value).startswith(str(path))
    return str(refused.value)
