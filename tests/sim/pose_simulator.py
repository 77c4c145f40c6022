"""Simulates an IMU laid down in pose after pose, from rotations alone: shares no code with the estimator or the bridge.

    gyro  = M⁻¹ mean rate + bias(t) + nonlinearity + G force + noise      rate = M (reading - bias)
    accel = S⁻¹ force + offset + noise                                    S symmetric: the frame of M is that of S

The rate of a sample is the mean over its interval, integrated in ten steps.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]
GRAVITY = 9.80665
_STEPS = 10


@dataclass(frozen=True, slots=True)
class Move:
    """One movement: rotation vector in the device's axes, rad, and its duration, s."""

    vector: tuple[float, float, float]
    seconds: float = 2.5


@dataclass(frozen=True, slots=True)
class Device:
    """Sizes of a device's errors. Constants are drawn uniformly within ± the value, white noise is a standard deviation."""

    noise_dps: float = 0.03
    accel_noise: float = 0.02
    accel_offset: float = 0.3
    accel_scale: float = 0.005
    accel_shear: float = 0.003
    scale: float = 0.01
    misalignment_deg: float = 1.0
    bias_dps: float = 3.0
    drift_dps_per_min: float = 0.0
    walk_dps_per_sqrt_s: float = 0.0
    #: relative error of the scale at 250 °/s, growing with the square of the rate
    nonlinearity: float = 0.0
    g_sensitivity_dps_per_g: float = 0.0


@dataclass(frozen=True, slots=True)
class Hand:
    """How a person moves the device: angles in degrees, standard deviations unless they say otherwise.

    replacement_deg: by how much a movement misses its end, per axis. wobble_deg: tilt on the way. creep_dps: the rate at
    which the device still turns in the last 1.5 s before and the first after each movement. sway_deg: amplitude of a slow
    sway, 0.2 to 0.6 Hz, in every rest. sway_accel: m/s², amplitude of the same in the acceleration.
    """

    rest_s: float = 3.0
    replacement_deg: float = 0.2
    wobble_deg: float = 1.0
    creep_dps: float = 0.0
    sway_deg: float = 0.0
    sway_accel: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """time (n,) s, gyro (n, 3) rad/s, accel (n, 3) m/s²; matrix M and shape S (3, 3) and bias (n, 3) rad/s are true."""

    time: Floats
    gyro: Floats
    accel: Floats
    matrix: Floats
    shape: Floats
    bias: Floats
    rate_hz: float


def simulate(seed: int, moves: Sequence[Move], device: Device, hand: Hand, rate_hz: float = 104.0) -> Session:
    """The session of this seed: rest, movement, rest … rest, beginning flat at any heading."""
    rng = np.random.default_rng(seed)
    fine = 1 / (rate_hz * _STEPS)
    attitude, force_error = _path(rng, moves, hand, fine)
    n = (len(attitude) - 1) // _STEPS
    steps = attitude[: n * _STEPS].inv() * attitude[1 : n * _STEPS + 1]
    rate = steps.as_rotvec().reshape(n, _STEPS, 3).mean(axis=1) / fine
    time = np.arange(1, n + 1) / rate_hz
    force = (
        attitude[_STEPS : n * _STEPS + 1 : _STEPS].inv().apply([0.0, 0.0, GRAVITY]) + force_error[_STEPS::_STEPS][:n]
    )

    across = np.radians(rng.uniform(-1, 1, (3, 3)) * device.misalignment_deg) * (1 - np.eye(3))
    matrix = np.diag(1 + device.scale * rng.uniform(-1, 1, 3)) @ (np.eye(3) + across)
    walk = np.cumsum(rng.normal(size=(n, 3)), axis=0) * device.walk_dps_per_sqrt_s / np.sqrt(rate_hz)
    drift = rng.choice([-1.0, 1.0], 3) * device.drift_dps_per_min * time[:, None] / 60
    bias = np.radians(device.bias_dps * rng.uniform(-1, 1, 3) + drift + walk)
    by_force = np.radians(device.g_sensitivity_dps_per_g * rng.uniform(-1, 1, (3, 3))) / GRAVITY
    gyro = rate @ np.linalg.inv(matrix).T
    if device.nonlinearity:
        gyro *= 1 + device.nonlinearity * (gyro / np.radians(250.0)) ** 2
        # The true matrix is the best straight one over the session's own rates.
        matrix = np.linalg.lstsq(gyro, rate, rcond=None)[0].T
    gyro += bias + force @ by_force.T + np.radians(device.noise_dps) * rng.normal(size=(n, 3))

    shear = device.accel_shear * rng.uniform(-1, 1, 3)
    shape = np.diag(1 + device.accel_scale * rng.uniform(-1, 1, 3))
    shape[[0, 0, 1], [1, 2, 2]] = shape[[1, 2, 2], [0, 0, 1]] = shear
    accel = force @ np.linalg.inv(shape).T + device.accel_offset * rng.uniform(-1, 1, 3)
    accel += device.accel_noise * rng.normal(size=(n, 3))
    return Session(time, gyro, accel, matrix, shape, bias, rate_hz)


def _path(rng: np.random.Generator, moves: Sequence[Move], hand: Hand, fine: float) -> tuple[Rotation, Floats]:
    """Attitudes, and the hand's own acceleration (n, 3), every `fine` seconds."""
    start = Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
    parts, errors = [], []
    for i in range(len(moves) + 1):
        swayed, error = _rest(rng, hand, fine, begins=i > 0, ends=i < len(moves))
        parts.append((start * swayed).as_quat())
        errors.append(error)
        start = start * swayed[-1]
        if i < len(moves):
            moved = _movement(rng, moves[i], hand, fine)
            parts.append((start * moved).as_quat())
            errors.append(np.zeros((len(moved), 3)))
            start = start * moved[-1]
    return Rotation.from_quat(np.concatenate(parts)), np.concatenate(errors)


def _movement(rng: np.random.Generator, move: Move, hand: Hand, fine: float) -> Rotation:
    x = np.arange(1, round(move.seconds / fine) + 1)[:, None] * fine / move.seconds
    smooth = x**3 * (10 - 15 * x + 6 * x**2)
    wobble = np.radians(hand.wobble_deg) * sum(
        np.sin(np.pi * x) ** 2 * np.sin(np.pi * h * x) * rng.normal(size=3) for h in (1, 2, 3)
    )
    missed = np.radians(hand.replacement_deg) * rng.normal(size=3)
    way = Rotation.from_rotvec(smooth * np.array(move.vector))
    return way * Rotation.from_rotvec(np.asarray(wobble) + smooth * missed)


def _rest(rng: np.random.Generator, hand: Hand, fine: float, *, begins: bool, ends: bool) -> tuple[Rotation, Floats]:
    t = np.arange(1, round(hand.rest_s / fine) + 1)[:, None] * fine
    hertz, phase = rng.uniform(0.2, 0.6, 3), rng.uniform(0, 2 * np.pi, 3)
    wave = np.sin(2 * np.pi * hertz * t + phase)
    tilt = np.radians(hand.sway_deg) * (wave - np.sin(phase))
    creep = np.radians(hand.creep_dps) * rng.choice([-1.0, 1.0], (2, 3)) / np.sqrt(3)
    lasts = min(1.5, hand.rest_s / 2)
    # The rate falls to nothing in a straight line after a movement, and rises so before the next one.
    after = creep[0] * (lasts / 2 - np.maximum(lasts - t, 0) ** 2 / (2 * lasts)) * begins
    before = creep[1] * np.maximum(t - (hand.rest_s - lasts), 0) ** 2 / (2 * lasts) * ends
    return Rotation.from_rotvec(tilt + after + before), hand.sway_accel * np.roll(wave, 1, axis=1)
