import numpy as np
import pytest

from bridge.sim.imu_errors import ImuSpec
from bridge.sim.motion_scripts import SessionPlan
from estimator.calibration import turn360
from estimator.calibration.result import judge
from tests.estimator.calibration.literal import algorithm1
from tests.estimator.calibration.sessions import capture
from tests.estimator.stream import calibration


@pytest.mark.parametrize("plan", [SessionPlan(), SessionPlan(wobble_deg=3.0, tilt_deg=5.0, replacement_deg=0.3)])
def test_it_is_the_papers_algorithm_to_the_letter(plan: SessionPlan) -> None:
    found = capture(calibration(seed=8, plan=plan, rate_hz=52.0))
    np.testing.assert_allclose(turn360.estimate(found).k, algorithm1(found), atol=1e-9, rtol=0)


def test_the_papers_bias_is_ours_with_the_other_sign() -> None:
    of = calibration(seed=9)
    found = turn360.estimate(capture(of))
    at_rest = (of.time > 0.3) & (of.time < 4.4)
    b_paper = -of.gyro[at_rest].mean(axis=0)
    np.testing.assert_allclose(-found.bias, b_paper, atol=np.radians(0.005))
    # g = K (m + b) with the paper's b is matrix (reading - bias) with ours.
    result = judge("turn360", capture(of), found.k, found.bias, found.covariance)
    reading = of.gyro[of.at(6.0) : of.at(6.1)]
    np.testing.assert_allclose(found.k * (reading - found.bias), (reading - result.bias) @ result.matrix.T)
    np.testing.assert_allclose(found.k * (reading - found.bias), of.rate[of.at(6.0) : of.at(6.1)], atol=np.radians(0.3))


def test_without_noise_it_finds_the_truth() -> None:
    of = calibration(seed=10, spec=ImuSpec(noise_dps=0.0), plan=SessionPlan(tilt_deg=5.0))
    found = turn360.estimate(capture(of))
    np.testing.assert_allclose(found.k, of.truth.k, atol=2e-7)
    np.testing.assert_allclose(found.bias, of.bias[0], atol=1e-12)


def test_its_covariance_is_what_repeating_shows() -> None:
    """Bias and k of 15 sessions, without and with a hand's errors: errors over published deviations."""
    for plan, low, high in (
        (SessionPlan(), 0.02, 1.2),  # the re-placement it assumes was perfect: too modest, never too bold
        (SessionPlan(replacement_deg=0.2), 0.4, 1.2),
        (SessionPlan(wobble_deg=3.0), 0.1, 1.2),
    ):
        k_score, bias_score = [], []
        for seed in range(15):
            of = calibration(seed=seed, plan=plan, rate_hz=52.0)
            found = turn360.estimate(capture(of))
            std = np.sqrt(np.diag(found.covariance))
            k_score.append((found.k - of.truth.k) / std[3:])
            bias_score.append((found.bias - of.bias[0]) / std[:3])
        assert low < np.sqrt(np.mean(np.square(k_score))) < high, plan
        assert 0.75 < np.sqrt(np.mean(np.square(bias_score))) < 1.25, plan
