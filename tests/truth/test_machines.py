"""Recordings on a turntable and a servo from a simulator that is none of this project's, with their true scale factors."""

from pathlib import Path

import numpy as np
import pytest

from bridge.recording import load
from bridge.wire.messages import Verdict
from estimator.offline.recordings import calibrate


@pytest.mark.parametrize(
    ("name", "method", "rates", "within"),
    [
        ("servo_accel_90mg", "servomotor", (25.42,), 1e-3),
        ("turntable_640s_flicker014", "turntable", (30.0, 60.0, 90.0), 2e-4),
    ],
)
def test_their_scale_is_within_what_is_said_of_it(
    name: str, method: str, rates: tuple[float, ...], within: float, shared_data: Path
) -> None:
    file = shared_data / "sessions" / f"{name}.npz"
    result, _ = calibrate(load(file), method, rates=tuple(np.radians(rates)))
    assert result.verdict is Verdict.ACCEPTED
    error = np.abs(result.scale - np.load(file)["true_k"])
    assert np.all(error < 3 * result.scale * result.scale_std)
    assert np.all(result.scale_std < within)
