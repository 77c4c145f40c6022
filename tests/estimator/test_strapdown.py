"""A span against the simulator's own motion, and every derivative it states against finite differences."""

from dataclasses import fields

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.sim.motion import Motion, TrueMotion
from bridge.sim.script import swing
from estimator.rotation import log
from estimator.strapdown import Span, sum_up

Floats = NDArray[np.float64]
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
    np.testing.assert_allclose(span.end, (first.inv() * attitude[-1]).as_matrix(), atol=1e-10)
    assert Rotation.from_matrix(span.end).magnitude() > 0.5, "it did turn"
    assert span.seconds == pytest.approx(2.0)
    # From ten times as many samples, each in its own attitude.
    fine, fine_dt = moving(10_400.0)
    axes = first.inv() * Rotation.from_quat(fine.attitude, scalar_first=True)
    true = fine_dt @ axes.apply(fine.force)
    np.testing.assert_allclose(span.push, true, atol=0.05)
    np.testing.assert_allclose(summed(1040.0).push, true, atol=0.005)
    growing = np.cumsum(axes.apply(fine.force) * fine_dt[:, None], axis=0)
    np.testing.assert_allclose(summed(1040.0).shift, fine_dt @ growing, atol=0.005)
    assert np.linalg.norm(span.push - dt @ motion.force) > 1.0, "forces had to be carried along"
    assert span.way == pytest.approx(np.linalg.norm(motion.rate, axis=1) @ dt)
    force = axes.apply(fine.force)
    assert span.unrest == pytest.approx(np.sqrt(np.mean(np.sum((force - force.mean(axis=0)) ** 2, axis=1))), rel=0.02)


def test_at_rest_nothing_turns_and_the_push_is_gravity() -> None:
    n = 104
    dt, up = np.full(n, 1 / n), np.array([0.0, 9.80665, 0.0])
    span = sum_up(dt, np.tile(BIAS, (n, 1)), np.tile(up, (n, 1)), MATRIX, BIAS, np.zeros(3))
    np.testing.assert_allclose(span.end, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(span.push, up)
    np.testing.assert_allclose(span.shift, up / 2)
    np.testing.assert_allclose(span.by_bias, -MATRIX)
    np.testing.assert_allclose([span.way, span.unrest], 0.0, atol=1e-12)


def test_a_sample_of_the_very_moment_of_the_one_before_adds_nothing() -> None:
    motion, dt = moving(104.0)
    gyro, accel = read(motion)
    again = np.insert(np.arange(len(dt)), 51, 50)
    twice = sum_up(np.insert(dt, 51, 0.0), gyro[again], accel[again], MATRIX, BIAS, ACCEL_BIAS)
    for part in fields(Span):
        alike = 0.02 if part.name == "unrest" else 1e-9  # which is a mean over samples
        np.testing.assert_allclose(getattr(twice, part.name), getattr(summed(), part.name), rtol=alike, atol=1e-12)


STEP = 1e-6
PARTS = {"bias": 3, "matrix": 9, "accel": 3}


@pytest.mark.parametrize("part", PARTS)
def test_derivatives_are_those_of_finite_differences(part: str) -> None:
    motion, dt = moving(208.0)
    gyro, accel = read(motion)

    def with_error(error: Floats) -> Span:
        bias = BIAS + (error if part == "bias" else 0.0)
        change = error.reshape(3, 3) if part == "matrix" else np.zeros((3, 3))
        accel_bias = ACCEL_BIAS + (error if part == "accel" else 0.0)
        return sum_up(dt, gyro, accel, (np.eye(3) + change) @ MATRIX, bias, accel_bias)

    span = with_error(np.zeros(PARTS[part]))
    turned, pushed = [], []
    for error in STEP * np.eye(PARTS[part]):
        plus, minus = with_error(error), with_error(-error)
        turned.append((log(plus.end @ span.end.T) - log(minus.end @ span.end.T)) / (2 * STEP))
        pushed.append((plus.push - minus.push) / (2 * STEP))
    told = {field.name: getattr(span, field.name) for field in fields(Span)}
    by_turn = np.zeros((3, 3)) if part == "accel" else told[f"by_{part}"]
    # A sample's own turn is taken at its middle: right to the square of what is turned within a sample.
    np.testing.assert_allclose(by_turn, np.transpose(turned), atol=2e-4)
    np.testing.assert_allclose(told[f"push_by_{part}"], np.transpose(pushed), rtol=4e-3, atol=2e-2)
    assert np.abs(told[f"push_by_{part}"]).max() > 1.0
