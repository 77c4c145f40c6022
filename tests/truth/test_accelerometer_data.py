"""Real accelerometers: what their calibration leaves, and imucal's six faces."""

from pathlib import Path

import numpy as np
import pytest

from bridge.recording import Recording, load
from bridge.wire.messages import Verdict
from estimator.offline.recordings import calibrate

pytestmark = pytest.mark.data
G = 9.80665


def test_imucal_ferraris(shared_data: Path) -> None:
    """Opposite faces give bias and scale at once (F. Ferraris, U. Grimaldi, M. Parvis, 1995), as imucal computes them."""
    with np.load(shared_data / "imucal" / "ferraris_session.npz") as file:
        sections = dict(zip(file["section_names"].tolist(), file["section_bounds"].tolist(), strict=True))
        face = {name: file["accel_m_s2"][a:b].mean(axis=0) for name, (a, b) in sections.items()}
    bias = [(face[f"{axis}_p"][i] + face[f"{axis}_a"][i]) / 2 for i, axis in enumerate("xyz")]
    scale = [2 * G / (face[f"{axis}_p"][i] - face[f"{axis}_a"][i]) for i, axis in enumerate("xyz")]
    result, _ = calibrate(load(shared_data / "imucal" / "ferraris_session.npz"))
    found = result.accelerometer
    assert found is not None
    assert found.verdict is Verdict.ACCEPTED
    np.testing.assert_allclose(found.bias, bias, atol=0.05)
    np.testing.assert_allclose(found.scale, scale, atol=0.005)


@pytest.mark.parametrize(("name", "left"), [("imu0", 0.03), ("imu3", 0.015)])
def test_rests_that_were_not_fitted_read_gravity(shared_data: Path, name: str, left: float) -> None:
    """Calibrated by the first two thirds of the recording, the rests of the last third read gravity."""
    recording = load(shared_data / "mikoff_mpu9150" / f"{name}.npz")
    cut = 2 * len(recording) // 3
    assert recording.accel is not None
    early = Recording.from_arrays(recording.gyro[:cut], recording.accel[:cut], recording.rate_hz)
    found = calibrate(early, "transitions")[0].accelerometer
    assert found is not None
    assert found.verdict is Verdict.ACCEPTED
    late = recording.accel[cut : cut + (len(recording) - cut) // 100 * 100].reshape(-1, 100, 3)
    rests = late.mean(axis=1)[late.std(axis=1).max(axis=1) < 0.15]
    strength = np.linalg.norm(np.array(found.scale) * (rests - found.bias), axis=1)
    assert len(rests) > 10
    assert np.sqrt(np.mean((strength - G) ** 2)) < left
    assert np.sqrt(np.mean((np.linalg.norm(rests, axis=1) - G) ** 2)) > 2 * left
