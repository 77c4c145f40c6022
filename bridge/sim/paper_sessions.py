"""Simulated calibration sessions of the paper: still, turn x, still, turn y, still, turn z, still; gyro only.

Source: Wang et al., Mechatronics 102 (2024) 103232, simulation. Scale factors are U(0.8, 1.2), biases U(-5, 5) °/s.
Turning axes deviate from the sensor axes by U(-10 %, 10 %). The speed follows a Bézier curve; the noise is white.
Additions to the paper: wobble of the hand, closure error, and sensors that sample points.

Averaging sensor: sample i is the mean rate over the interval that ends at its time. The mean rate turns one attitude
into the next exactly. Point-sampling sensor: sample i is the rate at the end of that interval.
"""

from dataclasses import dataclass
from functools import reduce
from math import comb
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bridge.sim.quaternion import Array, conjugate, from_rotvec, multiply, to_rotvec

_DEGREE = 5
#: half-width, in samples, of the mean that stands for a point's rate
_POINT = 1e-3


@dataclass(frozen=True, slots=True)
class PaperPlan:
    """Parameters of simulated calibration sessions of the paper.

    noise_dps: white noise, standard deviation per sample, °/s. rest_s: duration of each rest. turn_s: shortest and
    longest duration of a turn, s. rate_hz: output data rate.
    wobble_deg: amplitude of the swing of a turn's axis in space; the turn still closes.
    replacement_deg: closure error of a turn (end attitude against start attitude), standard deviation per axis.
    sampling: "mean" for readings that average the rate over an interval, "point" for the rate at its end.
    """

    noise_dps: float = 0.03
    wobble_deg: float = 0.0
    replacement_deg: float = 0.0
    rest_s: float = 3.0
    turn_s: tuple[float, float] = (4.0, 6.0)
    rate_hz: float = 104.0
    sampling: Literal["mean", "point"] = "mean"


@dataclass(frozen=True, slots=True, eq=False)
class PaperGyro:
    """True parameters of a gyro of the paper's simulation, in rate = k (reading - bias).

    k (3,): scale factors, without unit. bias (3,): rad/s. axes (3, 3): unit vectors of the turning axes, in rows,
    sensor axes.
    """

    k: Array
    bias: Array
    axes: Array


@dataclass(frozen=True, slots=True, eq=False)
class PaperSessions:
    """Simulated calibration sessions of one gyro: s sessions with four rests of m samples and three turns of n samples.

    rests (s, 4, m, 3), turns (s, 3, n, 3): readings, rad/s. rates (s, 3, n, 3): true rates of the turns, rad/s.
    dt (s, 3, n): duration of each turn sample, s; 0 after the turn's end. Vectors are in sensor axes.
    """

    gyro: PaperGyro
    rests: Array
    turns: Array
    rates: Array
    dt: Array


def draw_gyro(rng: np.random.Generator) -> PaperGyro:
    """Draw the true parameters of a gyro from the paper's distributions: scale factors, bias and turning axes."""
    axes = np.eye(3) + rng.uniform(-0.1, 0.1, (3, 3)) * (1 - np.eye(3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    return PaperGyro(rng.uniform(0.8, 1.2, 3), np.radians(rng.uniform(-5, 5, 3)), axes)


def simulate(gyro: PaperGyro, plan: PaperPlan, sessions: int, rng: np.random.Generator) -> PaperSessions:
    """Simulate calibration sessions of one gyro, each with its own turns and noise, drawn from rng.

    sessions: number of sessions.
    """
    counts = np.round(rng.uniform(*plan.turn_s, (sessions, 3)) * plan.rate_hz).astype(int)
    n = int(counts.max())
    dt = (np.arange(n) < counts[..., None]) / plan.rate_hz
    rates = _rates(gyro, plan, counts, dt, rng)
    noise = np.radians(plan.noise_dps)
    rests = gyro.bias + noise * rng.standard_normal((sessions, 4, round(plan.rest_s * plan.rate_hz), 3))
    turns = rates / gyro.k + gyro.bias + noise * rng.standard_normal(rates.shape)
    return PaperSessions(gyro, rests, turns, rates, dt)


def _rates(gyro: PaperGyro, plan: PaperPlan, counts: NDArray[np.int_], dt: Array, rng: np.random.Generator) -> Array:
    """True rates of the turns, (s, 3, n, 3)."""
    n = dt.shape[-1]
    at = np.arange(n + 1.0)
    first, second, samples = slice(None, -1), slice(1, None), 1.0
    if plan.sampling == "point":
        at = np.concatenate([at[1:] - _POINT, at[1:] + _POINT])
        first, second, samples = slice(None, n), slice(n, None), 2 * _POINT
    share = _bezier(rng.uniform(0.4, 1.6, (*counts.shape, _DEGREE - 1)), counts, at)
    angle = 2 * np.pi * rng.choice([-1.0, 1.0], counts.shape)[..., None] * share
    per_s = plan.rate_hz / samples
    if not plan.wobble_deg and not plan.replacement_deg:
        return np.asarray(((angle[..., second] - angle[..., first]) * per_s)[..., None] * gyro.axes[:, None])
    spin = angle[..., None] * gyro.axes[:, None]
    # Whole half swings, so that a turn closes: three to ten, some 0.3 to 1 Hz.
    swings = rng.integers(3, 11, (*counts.shape, 1, 3)) * rng.choice([-1.0, 1.0], (*counts.shape, 1, 3))
    tilt = np.radians(plan.wobble_deg) * np.sin(np.pi * share[..., None] * swings) * (1 - np.eye(3))[:, None]
    miss = share[..., None] * np.radians(plan.replacement_deg) * rng.standard_normal((*counts.shape, 1, 3))
    parts = (from_rotvec(part.reshape(-1, 3)) for part in (tilt, spin, miss))
    attitude = reduce(multiply, parts).reshape(*share.shape, 4)
    start, stop = (attitude[:, :, part].reshape(-1, 4) for part in (first, second))
    return to_rotvec(multiply(conjugate(start), stop)).reshape(*dt.shape, 3) * per_s


def _bezier(speed: Array, counts: NDArray[np.int_], at: Array) -> Array:
    """Share (s, 3, m) of the turn done at times `at` (m,), in samples: 0 to 1; the speed is a Bézier curve from 0 to 0."""
    # The integral of a Bézier curve is a Bézier curve of the cumulative sums of its control points.
    points = np.concatenate([np.zeros((*speed.shape[:-1], 2)), np.cumsum(speed, axis=-1)], axis=-1)
    points = np.concatenate([points, points[..., -1:]], axis=-1) / points[..., -1:]
    degree = points.shape[-1] - 1
    power = np.zeros((degree + 1, degree + 1))
    for i in range(degree + 1):
        for j in range(i, degree + 1):
            power[i, j] = (-1) ** (j - i) * comb(degree, i) * comb(degree - i, j - i)
    coefficients = points @ power
    u = np.minimum(at / counts[..., None], 1.0)
    done = np.zeros(u.shape)
    for j in range(degree, -1, -1):
        done = done * u + coefficients[..., j, None]
    return done
