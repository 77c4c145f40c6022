from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.sim.imu_errors import ImuSpec
from bridge.sim.motion_scripts import SessionPlan
from bridge.wire import codec, keys
from bridge.wire.messages import Quality, State, Verdict
from estimator.calibration import transitions
from estimator.calibration.accelerometer_errors import AccelKnobs
from estimator.calibration.gravity_propagation import (
    MATRIX_PARAMETERS,
    PARAMETERS,
    Problem,
    TransitionKnobs,
    Transitions,
)
from estimator.device.session import DeviceSession
from estimator.device.session_knobs import SessionKnobs
from estimator.offline import recordings
from tests.estimator.calibration.sessions import in_poses, movements, true_parameters
from tests.estimator.stream import Stream, calibration, feed
from tests.sentences import codes


@pytest.fixture(scope="module")
def session() -> tuple[Stream, Transitions]:
    of = in_poses(3)
    return of, movements(of)


def nees(of: Stream, found: transitions.Fit) -> float:
    error = found.theta[:12] - true_parameters(of)
    return float(error @ np.linalg.solve(found.covariance[:12, :12], error)) / 12


def test_without_noise_it_finds_the_truth_of_gyro_and_accelerometer() -> None:
    of = in_poses(1, noise_dps=0.0, accel_noise=0.0)
    found = transitions.fit(movements(of), TransitionKnobs(misalignment=1.0, accel=AccelKnobs(5.0, 1.0, 1.0)))
    np.testing.assert_allclose(found.theta[:12], true_parameters(of), atol=1e-5)
    np.testing.assert_allclose(found.theta[12:15], of.truth.accel_bias, atol=1e-4)
    np.testing.assert_allclose(found.theta[15:], 0.0, atol=2e-5)


def test_a_slow_general_solver_agrees(session: tuple[Stream, Transitions]) -> None:
    """The weights fixed, SciPy with numeric slopes comes to the same parameters."""
    _, data = session
    found = transitions.fit(data)
    problem = Problem(data, TransitionKnobs())
    problem.unit = max(found.misfit, transitions.LEAST_UNIT)
    factor = problem.whitened(found.theta)[2]
    start = found.theta + 1e-3 * np.random.default_rng(0).normal(size=len(PARAMETERS))
    slow = least_squares(lambda theta: problem.whitened(theta, factor)[0], start, x_scale=1e-2, xtol=1e-12, ftol=1e-12)
    std = np.sqrt(np.diag(found.covariance))
    assert np.abs((slow.x - found.theta) / std).max() < 0.02


def test_its_slopes_are_those_of_its_residuals(session: tuple[Stream, Transitions]) -> None:
    _, data = session
    knobs = TransitionKnobs()
    problem, theta = Problem(data, knobs), transitions.fit(data).theta
    r, J, factor = problem.whitened(theta)
    for p in range(len(PARAMETERS)):
        step = np.zeros(len(PARAMETERS))
        step[p] = 1e-6
        slope = (problem.whitened(theta + step, factor)[0] - problem.whitened(theta - step, factor)[0]) / 2e-6
        np.testing.assert_allclose(slope, J[:, p], atol=2e-3 * np.abs(J[:, p]).max(), err_msg=PARAMETERS[p])
    assert len(r) == len(J)


def test_a_movement_that_contradicts_is_left_out(session: tuple[Stream, Transitions]) -> None:
    of, data = session
    samples = list(data.samples)
    samples[4] = replace(samples[4], gyro=samples[4].gyro * 1.15)
    found = transitions.estimate(replace(data, samples=tuple(samples)))
    assert (found.left_out, found.full) == (1, True)
    assert nees(of, found) < 1.0


def test_poses_of_all_kinds_give_the_full_matrix_from_a_recording() -> None:
    of = in_poses(5)
    result, passed_over = recordings.calibrate(of.recording(), "transitions")
    assert result.verdict is Verdict.ACCEPTED
    assert passed_over == []
    assert result.parameters == MATRIX_PARAMETERS
    assert result.covariance.shape == (12, 12)
    assert result.reason[0] == Code.FULL_MATRIX()
    np.testing.assert_allclose(result.matrix, of.truth.matrix, atol=1e-3)
    np.testing.assert_allclose(result.scale_std, np.sqrt(np.diag(result.covariance)[3:6]) / result.scale)


def test_three_full_turns_give_the_diagonal_and_say_why() -> None:
    of = calibration(seed=30, spec=ImuSpec(misalignment_deg=0.5), plan=SessionPlan(turn_s=(4.0, 5.0), tilt_deg=3.0))
    result, _ = recordings.calibrate(of.recording(), "transitions")
    assert result.verdict is Verdict.ACCEPTED
    assert len(result.parameters) == 6
    assert Code.DIAGONAL_ONLY in codes(result.reason)
    np.testing.assert_array_equal(result.matrix, np.diag(result.scale))
    error = result.scale - of.truth.k
    assert (np.abs(error) < 4 * np.sqrt(np.diag(result.covariance)[3:6])).all()
    assert len(result.turns) == 3


@pytest.mark.parametrize(
    ("limit", "words"),
    [
        (("CONDITION", 1.0), "The poses do not determine the full matrix. The condition number"),
        (("FEWEST", 99), "16 movements are too few for a full matrix. Make at least 99"),
    ],
)
def test_a_full_matrix_needs_poses_that_show_it_and_movements_enough(
    monkeypatch: pytest.MonkeyPatch, limit: tuple[str, float], words: str
) -> None:
    of = in_poses(4, 16)
    assert recordings.calibrate(of.recording(), "transitions")[0].parameters == MATRIX_PARAMETERS
    monkeypatch.setattr(transitions, *limit)
    result, _ = recordings.calibrate(of.recording(), "transitions")
    assert (result.verdict, result.parameters) == (Verdict.ACCEPTED, PARAMETERS[:6])
    assert words in english(*result.reason)


@pytest.mark.parametrize("method", ["transitions", "accel_aided"])
def test_without_an_accelerometer_it_is_refused(method: str) -> None:
    result, _ = recordings.calibrate(in_poses(6, 4).recording(accel=False), method)
    assert result.verdict is Verdict.REFUSED
    assert Code.NO_CHECKED_MOVEMENT in codes(result.reason)
    assert not np.isfinite(result.covariance).any()


def test_a_device_is_calibrated_by_poses_alone_and_its_misalignment_corrected_live() -> None:
    of = in_poses(7, 14, after=4)
    device = DeviceSession("chest", SessionKnobs(method="transitions"))
    outcome = feed(device, of.batches())
    assert outcome.calibration is not None
    assert device.life.state is State.TRACKING
    assert outcome.calibration.parameters == MATRIX_PARAMETERS
    key = keys.build("ward", "calibration", device="chest")
    sent = codec.decode_calibration(key, codec.encode_calibration(outcome.calibration))
    np.testing.assert_array_equal(sent.covariance, outcome.calibration.covariance)
    np.testing.assert_allclose(outcome.calibration.matrix, of.truth.matrix, atol=3e-3)
    last = outcome.corrected[-1]
    assert last.quality is Quality.GOOD
    assert (last.scale_std < 5e-3).all()
    during = [b for b in outcome.corrected if b.quality is Quality.GOOD]
    start = during[0].sequence
    rate = np.concatenate([b.rate for b in during])
    np.testing.assert_allclose(rate, of.rate[start : start + len(rate)], atol=np.radians(0.5))
