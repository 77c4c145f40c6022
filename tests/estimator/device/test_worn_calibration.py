"""A matrix that gravity teaches while the device is worn, and a calibration by hand that starts from it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from bridge.recording import Recording
from bridge.wire.messages import Calibration, Verdict
from estimator.calibration.gravity_propagation import MATRIX_PARAMETERS
from estimator.calibration.result import Result
from estimator.config.device_settings import knobs_of, learning
from estimator.device.worn_calibration import METHOD, combined
from estimator.noise.device_model import load_model
from estimator.offline.calibration_file import of_result
from estimator.offline.corrected_recording import CorrectedRecording
from estimator.offline.recordings import correct
from tests.sim.scenes import rests_and_motion

MATRIX = np.eye(3) + 0.01 * np.random.default_rng(7).uniform(-1, 1, (3, 3))


@cache
def lived(*, learn: bool) -> CorrectedRecording:
    """Ten minutes of rests and free movement, read through MATRIX by a simulator that shares no code."""
    day = rests_and_motion(1, 600.0, 50.0, rrw_dps_per_sqrt_s=7e-4)
    gyro, bias = day.gyro.astype(float), day.bias.astype(float)
    read = Recording.from_arrays(
        (gyro - bias) @ np.linalg.inv(MATRIX).T + bias, day.accel.astype(float), rate_hz=day.rate_hz
    )
    knobs = knobs_of(load_model("icm-20948"))
    return correct(read, knobs=learning(knobs) if learn else knobs)


def test_movement_teaches_scale_and_misalignment() -> None:
    found = lived(learn=True)
    assert found.calibration
    left, before = found.matrix - MATRIX, MATRIX - np.eye(3)
    assert np.linalg.norm(left) < 0.75 * np.linalg.norm(before)
    assert np.abs(np.diag(left)).max() < 0.003
    # A rotation between gyroscope and accelerometer turns no heading; what does is the symmetric part.
    assert np.linalg.norm(left + left.T) < 0.6 * np.linalg.norm(before + before.T)


def test_nothing_is_learnt_unless_it_is_asked_for() -> None:
    assert not lived(learn=False).calibration
    np.testing.assert_array_equal(lived(learn=False).matrix, np.eye(3))


def worn() -> Calibration:
    covariance = np.diag(np.repeat([1e-8, 1e-5, 4e-6], [3, 3, 6]))
    covariance[3, 6] = covariance[6, 3] = 4e-6  # k_x and m_xy are known together
    result = Result(
        METHOD, Verdict.ACCEPTED, (), MATRIX, np.zeros(3), covariance, np.full(3, 1e-3), parameters=MATRIX_PARAMETERS
    )
    return of_result(result)


def by_hand(scale: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Result:
    covariance = np.diag(np.repeat([1e-8, 2.5e-7], 3))
    return Result("closure", Verdict.ACCEPTED, (), np.diag(scale), np.zeros(3), covariance, np.full(3, 1e-3))


def test_a_calibration_by_hand_starts_from_it() -> None:
    found = combined(by_hand(np.diag(MATRIX) + 1e-3), worn())
    assert found.method == "closure"
    assert found.parameters == MATRIX_PARAMETERS
    np.testing.assert_allclose(found.scale, np.diag(MATRIX) + 1e-3, atol=1e-4)
    assert found.matrix[0, 1] == pytest.approx(MATRIX[0, 1] + 0.4e-3, abs=2e-5), (
        "what goes with the scale moves with it"
    )
    assert found.matrix[1, 0] == MATRIX[1, 0]
    assert (np.diag(found.covariance)[3:6] < 2.5e-7).all()


def test_a_calibration_by_hand_that_disagrees_stands_alone() -> None:
    alone = by_hand(np.diag(MATRIX) + 0.05)
    assert combined(alone, worn()) is alone
    assert combined(alone, replace(worn(), parameters=MATRIX_PARAMETERS[:6])) is alone
