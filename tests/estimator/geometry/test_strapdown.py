"""A span against the simulator's own motion, and every derivative it states against finite differences."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bridge.sim.motion import Motion, TrueMotion
from bridge.sim.motion_scripts import swing
from estimator.geometry.rotation import Floats, log
from estimator.geometry.strapdown import Span, sum_up
from estimator.kernels import strapdown as loop

START = np.array([0.5, -0.5, 0.5, 0.5])
MATRIX = np.array([[1.1, 0.02, -0.01], [0.0, 0.9, 0.03], [0.015, -0.02, 1.05]])
BIAS, ACCEL_BIAS = np.radians([3.0, -2.0, 1.0]), np.array([0.1, -0.2, 0.05])


def moving(rate_hz: float) -> tuple[TrueMotion, Floats]:
    """A second of a wearer's movement, from rest on, and the intervals of its samples."""
    time = np.arange(1, round(2.0 * rate_hz) + 1) / rate_hz
    motion = Motion([swing(np.random.default_rng(3), 3.0, np.radians(200.0))], START).advance(time)
    return motion, np.diff(time, prepend=0.0)


def read(motion: TrueMotion) -> tuple[Floats, Floats]:
    """What sensors with those errors make of it."""
    return motion.rate @ np.linalg.inv(MATRIX).T + BIAS, motion.force + ACCEL_BIAS


def summed(rate_hz: float = 104.0) -> Span:
    motion, dt = moving(rate_hz)
    return sum_up(dt, *read(motion), MATRIX, BIAS, ACCEL_BIAS)


def test_attitude_and_push_are_those_of_the_true_motion() -> None:
    motion, dt = moving(104.0)
    span = summed()
    attitude = Rotation.from_quat(motion.attitude, scalar_first=True)
    first = Rotation.from_quat(START, scalar_first=True)
    np.testing.assert_allclose(span.rows[loop.END], (first.inv() * attitude[-1]).as_matrix(), atol=1e-10)
    assert Rotation.from_matrix(span.rows[loop.END]).magnitude() > 0.5, "it did turn"
    assert span.seconds == pytest.approx(2.0)
    # From ten times as many samples, each in its own attitude.
    fine, fine_dt = moving(10_400.0)
    axes = first.inv() * Rotation.from_quat(fine.attitude, scalar_first=True)
    true = fine_dt @ axes.apply(fine.force)
    np.testing.assert_allclose(span.rows[loop.PUSH], true, atol=0.05)
    np.testing.assert_allclose(summed(1040.0).rows[loop.PUSH], true, atol=0.005)
    growing = np.cumsum(axes.apply(fine.force) * fine_dt[:, None], axis=0)
    np.testing.assert_allclose(summed(1040.0).rows[loop.SHIFT], fine_dt @ growing, atol=0.005)
    assert np.linalg.norm(span.rows[loop.PUSH] - dt @ motion.force) > 1.0, "forces had to be carried along"
    assert span.way == pytest.approx(np.linalg.norm(motion.rate, axis=1) @ dt)
    stray = growing - np.outer(np.cumsum(fine_dt) / fine_dt.sum(), true)
    assert summed(1040.0).unrest == pytest.approx(np.linalg.norm(stray.std(axis=0)), rel=0.01)
    assert span.unrest == pytest.approx(summed(1040.0).unrest, rel=0.05)


@pytest.mark.parametrize("turn", [1e-9, 1e-3, 0.0999, 0.1001, 0.5, 3.0])
def test_a_single_turn_is_exact_whether_small_or_large(turn: float) -> None:
    axis = np.array([0.6, -0.48, 0.64])
    span = sum_up(np.array([0.5]), turn / 0.5 * axis[None], np.zeros((1, 3)), np.eye(3), np.zeros(3), np.zeros(3))
    expected = Rotation.from_rotvec(turn * axis).as_matrix()
    np.testing.assert_allclose(span.rows[loop.END] - np.eye(3), expected - np.eye(3), rtol=1e-12, atol=1e-15)
    assert span.way == pytest.approx(turn)


STEP = 1e-6
PARTS = {"bias": 3, "matrix": 9, "accel": 3}


@pytest.mark.parametrize("part", PARTS)
def test_derivatives_are_those_of_finite_differences(part: str) -> None:
    motion, dt = moving(208.0)
    gyro, accel = read(motion)

    def with_error(error: Floats) -> Span:
        bias = BIAS + (error if part == "bias" else 0.0)
        change = error if part == "matrix" else np.zeros(9)
        accel_bias = ACCEL_BIAS + (error if part == "accel" else 0.0)
        return sum_up(dt, gyro, accel, MATRIX, bias, accel_bias, change)

    rows = with_error(np.zeros(PARTS[part])).rows
    end = rows[loop.END]
    turned, pushed = [], []
    for error in STEP * np.eye(PARTS[part]):
        plus, minus = with_error(error).rows, with_error(-error).rows
        turned.append((log(plus[loop.END] @ end.T) - log(minus[loop.END] @ end.T)) / (2 * STEP))
        pushed.append((plus[loop.PUSH] - minus[loop.PUSH]) / (2 * STEP))
    by_turn = np.zeros((3, 3)) if part == "accel" else rows[getattr(loop, f"BY_{part.upper()}")].reshape(3, -1)
    by_push = rows[getattr(loop, f"PUSH_BY_{part.upper()}")].reshape(3, -1)
    # A sample's own turn is taken at its middle: right to the square of what is turned within a sample.
    np.testing.assert_allclose(by_turn, np.transpose(turned), atol=2e-4)
    np.testing.assert_allclose(by_push, np.transpose(pushed), rtol=4e-3, atol=2e-2)
    assert np.abs(by_push).max() > 1.0
