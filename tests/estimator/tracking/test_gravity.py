"""Gravity carried along: how the state goes on, against finite differences of it."""

import numpy as np
import pytest

from estimator.geometry.strapdown import sum_up
from estimator.tracking.bias_filter import BiasFilter
from estimator.tracking.bias_state import BIAS, SLOPE, BiasKnobs, BiasState, Floats, start
from estimator.tracking.evidence import Receipt
from estimator.tracking.gravity import ACCEL_BIAS, GRAVITY, MATRIX, SIZE, VELOCITY, G, Gravity, GravityKnobs

N, STEP = 400, 1e-6
UP = np.array([0.48, 0.6, 0.64])


def moved(x: Floats, var: float = 0.0) -> tuple[Floats, Floats]:
    """The state after a second of motion, from a state x, and the covariance a state known but for STEP² gets."""
    gravity = Gravity(GravityKnobs(accel_noise=0.0, accel_walk=0.0, accel_pose=0.0, way_share=0.0))
    knobs = BiasKnobs()
    begun = gravity.extend(start(np.zeros(3), np.eye(3), 0.0, knobs), np.full(3, 0.01), np.full(3, 0.01))
    state = BiasState(x, var * np.eye(SIZE), begun.time)
    bias = BiasFilter(state, knobs)
    gravity.state.known = True
    time = np.arange(1, N + 1) / N
    gyro = np.column_stack([np.sin(3 * time), 0.7 * np.cos(2 * time), 0.5 * np.ones(N)])
    accel = G * UP + np.column_stack([np.cos(5 * time), np.sin(4 * time), time])
    span = sum_up(np.full(N, 1 / N), gyro, accel, np.eye(3), x[BIAS], x[ACCEL_BIAS], x[MATRIX])
    bias.predict(bias.time, carried=gravity.carry(span, bias, 0.0))
    return bias.x.copy(), bias.cov.copy()


def first() -> Floats:
    x = np.zeros(SIZE)
    x[BIAS], x[ACCEL_BIAS], x[GRAVITY], x[VELOCITY] = [0.01, -0.02, 0.03], [0.1, -0.05, 0.02], G * UP, [0.1, 0.2, -0.1]
    return x


def test_the_covariance_follows_the_state() -> None:
    x = first()
    F = np.column_stack([(moved(x + e)[0] - moved(x - e)[0]) / (2 * STEP) for e in STEP * np.eye(SIZE)])
    # The strength of gravity is known: along it nothing of what is estimated stays, in the state itself.
    at = moved(x)[0][GRAVITY]
    across = np.eye(SIZE)
    across[GRAVITY, GRAVITY] -= np.outer(at, at) / (at @ at)
    var = 1e-6  # in which what is of second order is lost
    P = (moved(x, var)[1] - moved(x)[1]) / var
    np.testing.assert_allclose(across @ P @ across.T, across @ F @ F.T @ across.T, atol=0.02, rtol=1e-2)
    assert np.abs(F[VELOCITY, BIAS]).max() > 1
    np.testing.assert_array_equal(F[SLOPE, SLOPE], np.eye(3))


def resting(bias_std: float = 1e-3) -> tuple[Gravity, BiasFilter]:
    """Gravity in a filter that knows the gyro well."""
    gravity, knobs = Gravity(GravityKnobs()), BiasKnobs()
    begun = start(np.zeros(3), bias_std**2 * np.eye(3), 0.0, knobs)
    return gravity, BiasFilter(gravity.extend(begun, np.full(3, 1e-3), np.full(3, 1e-3)), knobs)


@pytest.mark.parametrize(("ratio", "grows"), [(0.5, True), (2.0, False)], ids=["a walk", "too unlikely"])
def test_a_velocity_that_lasts_is_believed_less_unless_it_cannot_be_one(*, ratio: float, grows: bool) -> None:
    """A mirrored accelerometer contradicts for as long as it is there; believed less, it would be found out later."""
    gravity, bias = resting()
    span = sum_up(np.full(N, 1 / N), np.zeros((N, 3)), np.tile(G * UP, (N, 1)), np.eye(3), np.zeros(3), np.zeros(3))
    bias.predict(bias.time, carried=gravity.carry(span, bias, 1e-4))
    first = gravity.evidence(span, resting=False).R[0, 0]
    said = Receipt(0.0, "gravity", np.array([0.1, 0.0, 0.0]), np.eye(3), ratio, accepted=True)
    for _ in range(120):
        gravity.heard(said, span, resting=False)
    assert (gravity.evidence(span, resting=False).R[0, 0] > first) == grows
