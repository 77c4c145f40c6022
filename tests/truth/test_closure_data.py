"""The closure calibration on real recordings, and on sessions of a simulator that shares no code with this project."""

from math import degrees
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.recording import Recording
from bridge.wire.messages import Verdict
from estimator.calibration import closure
from estimator.calibration.capture import Capture, Rest, Samples, TurnCapture
from estimator.calibration.closure import ClosureKnobs
from estimator.calibration.replacement_error import Replacement
from estimator.geometry.gyro_model import least_step
from estimator.offline import recordings

pytestmark = pytest.mark.data
Floats = NDArray[np.float64]
SIMULATED = [
    f"noise{noise}_wobble{wobble}_{seed}" for noise in ("0.03", "0.15") for wobble in (0, 3) for seed in range(100, 104)
]
#: those sessions' hand puts the device back exactly, and their bias stays
EXACT = ClosureKnobs(Replacement(1e-9), misalignment_std=0.0, rate_random_walk=0.0)


def cut(time: Floats, gyro: Floats, bounds: NDArray[np.int64]) -> Capture:
    """A capture at known stages: the first rest, then each turn; what is between turns is rest."""
    edges = [*bounds[1:, 0], len(gyro)]
    spans = [(0, edges[0]), *((end, after) for (_, end), after in zip(bounds[1:], edges[1:], strict=True))]
    rests = [
        Rest(
            time[a],
            time[b - 1],
            gyro[a:b].mean(axis=0),
            gyro[a:b].std(axis=0, ddof=1),
            least_step(gyro[a:b]),
            b - a,
            None,
        )
        for a, b in spans
    ]
    x, y, z = (
        TurnCapture(axis, Samples(time[a:b], gyro[a:b], None, np.zeros(b - a, bool)), rests[axis], rests[axis + 1])
        for axis, (a, b) in enumerate(bounds[1:])
    )
    return Capture(rests[0], (x, y, z), tuple(rests))


@pytest.mark.parametrize("name", SIMULATED)
def test_an_independent_prototype_found_the_same(shared_data: Path, name: str) -> None:
    with np.load(shared_data / "simulated" / f"{name}.npz") as data:
        gyro = data["gyro_rad_s"].astype(float)
        time = np.arange(1, len(gyro) + 1) / float(data["rate_hz"])
        found = closure.estimate(cut(time, gyro, data["stage_bounds"]), EXACT)
        std = np.sqrt(np.diag(found.covariance))
        assert np.all(np.abs(found.k - data["closure_k"]) < 0.15 * std[3:])
        # The prototype took the noise of a turn without its scale factor, 0.8 to 1.2.
        np.testing.assert_allclose(np.degrees(std[:3]), data["closure_std"][:3], rtol=0.06)
        np.testing.assert_allclose(std[3:], data["closure_std"][3:], rtol=0.2)
        assert np.all(np.abs(found.k - data["truth_k"]) < 4 * std[3:])
        assert np.all(np.abs(found.bias - data["truth_bias_rad_s"]) < 4 * std[:3])


@pytest.mark.parametrize("name", SIMULATED[::3])
def test_and_so_does_the_whole_way_from_the_stream(shared_data: Path, name: str) -> None:
    with np.load(shared_data / "simulated" / f"{name}.npz") as data:
        gyro, rate = data["gyro_rad_s"].astype(float), float(data["rate_hz"])
        recording = Recording(np.arange(1, len(gyro) + 1) / rate, gyro, None, None, rate, name)
        result, _ = recordings.calibrate(recording)
        assert result.verdict is Verdict.ACCEPTED
        assert result.method == "closure"
        k_prototype = np.degrees(data["closure_std"][3:])
        assert np.all(np.abs(result.scale - data["closure_k"]) < np.maximum(5e-5, 0.05 * k_prototype))


def test_imucals_session_closes(shared_data: Path) -> None:
    """Measured with other tools: 0.058, 0.027, 0.010 degrees (imucal itself); k 0.9728, 1.0179, 1.0018 (the paper's)."""
    with np.load(shared_data / "imucal" / "ferraris_session.npz") as data:
        gyro, accel, rate = data["gyro_rad_s"], data["accel_m_s2"], float(data["rate_hz"])
    recording = Recording(np.arange(1, len(gyro) + 1) / rate, gyro, accel, None, rate, "imucal")
    for used in (recording, Recording(recording.time_s, gyro, None, None, rate, "imucal, gyro only")):
        result, _ = recordings.calibrate(used)
        assert result.verdict is Verdict.ACCEPTED
        errors = [degrees(turn.closure_error) for turn in result.turns]
        assert np.all(np.array(errors) <= [0.06, 0.03, 0.012]), errors
        np.testing.assert_allclose(result.scale, [0.9728, 1.0179, 1.0018], atol=5e-4)
        # imucal's Ferraris calibration of the session, inverted: it too takes each turn for 360 degrees.
        np.testing.assert_allclose(result.scale, [0.97283, 1.01789, 1.00169], atol=5e-4)
        assert np.all(result.scale_std < 1.2e-3)
