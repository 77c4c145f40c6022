"""Both calibrations on many sessions at once are those on each; the bound is the information at the truth."""

import numpy as np
import pytest

from bridge.sim.paper_sessions import PaperPlan, PaperSessions, draw_gyro, simulate
from estimator.calibration import closure, turn360
from estimator.calibration.capture import Capture, Rest, Samples, TurnCapture
from estimator.calibration.closure import ClosureKnobs
from estimator.calibration.replacement_error import Replacement
from estimator.geometry.gyro_model import least_step
from estimator.study import many


@pytest.fixture(scope="module")
def sessions() -> PaperSessions:
    rng = np.random.default_rng(1)
    return simulate(draw_gyro(rng), PaperPlan(0.1, wobble_deg=3.0, replacement_deg=0.2), 4, rng)


def capture(of: PaperSessions, s: int) -> Capture:
    """One session as the product would see it, its stages known."""
    rests = [
        Rest(10.0 * i, 10.0 * i + 3, x.mean(axis=0), x.std(axis=0, ddof=1), least_step(x), len(x), None)
        for i, x in enumerate(of.rests[s])
    ]
    turns = []
    for i in range(3):
        n = int((of.dt[s, i] > 0).sum())
        time = 10.0 * i + 3 + np.arange(1, n + 1) / 104.0
        turns.append(TurnCapture(i, Samples(time, of.turns[s, i, :n], None, np.zeros(n, bool)), rests[i], rests[i + 1]))
    return Capture(rests[0], (turns[0], turns[1], turns[2]), tuple(rests))


def test_algorithm_1_on_many_is_algorithm_1_on_each(sessions: PaperSessions) -> None:
    together = many.algorithm1(sessions)
    for s, theta in enumerate(together):
        alone = turn360.estimate(capture(sessions, s))
        np.testing.assert_allclose(theta, [*alone.bias, *alone.k], atol=1e-10)


def test_closure_on_many_is_closure_on_each(sessions: PaperSessions) -> None:
    std = np.radians(0.2)
    together, covariance = many.closure(many.evidence(sessions, std))
    knobs = ClosureKnobs(Replacement(std), misalignment_std=0.0, rate_random_walk=0.0, honest_p=0.0)
    for s in range(len(together)):
        alone = closure.estimate(capture(sessions, s), knobs)
        np.testing.assert_allclose(together[s], [*alone.bias, *alone.k], atol=1e-9)
        np.testing.assert_allclose(covariance[s], alone.covariance, rtol=1e-6, atol=1e-15)


def test_the_bound_is_the_information_at_the_truth() -> None:
    """By differences of a path integrated one step after the other."""
    rng = np.random.default_rng(2)
    gyro = draw_gyro(rng)
    of = simulate(gyro, PaperPlan(0.03, wobble_deg=3.0), 1, rng)
    truth, noise = np.concatenate([gyro.bias, gyro.k]), np.radians(0.03)
    clean = of.rates[0] / gyro.k + gyro.bias
    information = np.zeros((6, 6))
    information[:3, :3] = np.eye(3) * 4 * of.rests.shape[2] / noise**2
    for i in range(3):
        from scipy.spatial.transform import Rotation

        def end(theta: np.ndarray[tuple[int, ...], np.dtype[np.float64]], i: int = i) -> Rotation:
            steps = Rotation.from_rotvec(theta[3:] * (clean[i] - theta[:3]) * of.dt[0, i, :, None])
            attitude = Rotation.identity()
            for step in steps:
                attitude = attitude * step
            return attitude

        slope = np.stack(
            [(end(truth + h) * end(truth - h).inv()).as_rotvec() / 2e-6 for h in 1e-6 * np.eye(6)], axis=-1
        )
        spread, attitude = np.zeros((3, 3)), Rotation.identity()
        for rate, dt in zip(of.rates[0, i], of.dt[0, i], strict=True):
            attitude = attitude * Rotation.from_rotvec(rate * dt)
            part = attitude.as_matrix() * gyro.k * dt * noise
            spread += part @ part.T
        information += slope.T @ np.linalg.solve(spread, slope)
    bound = many.bound(of, noise, 0.0)[0]
    np.testing.assert_allclose(bound, np.diag(np.linalg.inv(information)), rtol=2e-3)
