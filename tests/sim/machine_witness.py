"""Recordings of a gyro on a turntable or a servo, from a simulator that shares no code with the estimator or bridge.sim.

    reading = (K (I + E))⁻¹ rate + G gravity + bias(t) + white noise, K = diag(k), E with a zero diagonal
    bias(t) = constant + drift t + random walk + flicker; the flicker is white noise shaped to a density B²/(pi f)

The machine's axis is along `up` in the device's case. Between mountings a hand turns the device about any axis.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
G = 9.80665


@dataclass(frozen=True)
class Unit:
    """What a device and a machine err by; standard deviations but for what is said to be a value.

    Angles in °, rates in °/s, offsets in mg. flicker, walk and drift (°/s²) are values.
    """

    noise: float = 0.07
    flicker: float = 0.014
    walk: float = 7e-4
    drift: float = 0.0
    scale: float = 0.08
    misalignment: float = 0.0
    offset: float = 0.0
    accel_scale: float = 0.0
    g_sensitivity: float = 0.0
    bias: float = 2.0
    #: relative, of the rate of each spin
    rate_share: float = 0.0
    #: of each fixing
    square: float = 0.0


@dataclass(frozen=True)
class Plan:
    """Mountings `up` (m, 3), rates °/s of each in order, seconds of each spin and rest."""

    up: Floats
    rates: tuple[float, ...]
    spin_s: float = 5.0
    rest_s: float = 2.5
    ramp_s: float = 0.6
    rate_hz: float = 104.0


@dataclass(frozen=True)
class Read:
    """Samples (n,), (n, 3), (n, 3) in s, rad/s, m/s², and the truth: k (3,)."""

    time: Floats
    gyro: Floats
    accel: Floats
    k: Floats = field(default_factory=lambda: np.ones(3))


def recorded(plan: Plan, unit: Unit, seed: int) -> Read:
    """One recording."""
    rng = np.random.default_rng((44, seed))
    dt = 1 / plan.rate_hz
    rate, up = _motion(plan, unit, rng, dt)
    n = len(rate)
    k: Floats = np.asarray(1 + np.clip(unit.scale * rng.normal(size=3), -0.2, 0.2), np.float64)
    askew = np.radians(unit.misalignment) * rng.normal(size=(3, 3))
    np.fill_diagonal(askew, 0.0)
    matrix = np.diag(k) @ (np.eye(3) + askew)
    time = dt * np.arange(n, dtype=np.float64)
    walk = np.cumsum(unit.walk * np.sqrt(dt) * rng.normal(size=(n, 3)), axis=0)
    bias = unit.bias * rng.normal(size=3) + walk + _flicker(unit.flicker, n, dt, rng)
    bias = bias + unit.drift * time[:, None] * [1.0, -0.6, 0.3] + unit.g_sensitivity * up @ rng.normal(size=(3, 3))
    noise = unit.noise * rng.normal(size=(n, 3))
    gyro = np.linalg.solve(matrix, np.radians(rate).T).T + np.radians(bias + noise)
    off = unit.offset * 1e-3 * rng.normal(size=3)
    accel = G * (up * (1 + unit.accel_scale * rng.normal(size=3)) + off) + 0.03 * rng.normal(size=(n, 3))
    return Read(time, gyro, accel, k)


def _motion(plan: Plan, unit: Unit, rng: np.random.Generator, dt: float) -> tuple[Floats, Floats]:
    """Rate °/s and the direction of up (n, 3) in the case's axes."""
    rates, ups = [], []

    def add(speed: Floats, axis: Floats, up: Floats) -> None:
        rates.append(speed[:, None] * axis)
        ups.append(np.broadcast_to(up, (len(speed), 3)))

    still = np.zeros(round(plan.rest_s / dt))
    for up in plan.up:
        tilt = np.radians(unit.square) * rng.normal(size=3)
        axis = up + np.cross(tilt, up)
        axis = axis / np.linalg.norm(axis)
        hand = rng.normal(size=3)
        add(
            rng.uniform(60, 150) * np.sin(np.linspace(0, np.pi, round(1.5 / dt))) ** 2,
            hand / np.linalg.norm(hand),
            axis,
        )
        add(still, axis, axis)
        ramp = np.linspace(0, 1, round(plan.ramp_s / dt))
        for told in plan.rates:
            speed = told * (1 + unit.rate_share * rng.normal())
            shape = np.concatenate([ramp, np.ones(round(plan.spin_s / dt)), ramp[::-1]])
            add(speed * shape, axis, axis)
            add(still, axis, axis)
    return np.concatenate(rates), np.concatenate(ups)


def _flicker(instability: float, n: int, dt: float, rng: np.random.Generator) -> Floats:
    """(n, 3) noise of one-sided density B²/(pi f), from 1 / four times the length of the recording up."""
    longer = 2 ** int(np.ceil(np.log2(4 * n)))
    f = np.fft.rfftfreq(longer, dt)
    shape = np.zeros(len(f))
    shape[1:] = instability / np.sqrt(np.pi * f[1:])
    # White noise of unit variance has the one-sided density 2 dt.
    white = np.fft.rfft(rng.normal(size=(longer, 3)), axis=0)
    return np.asarray(np.fft.irfft(white * (shape / np.sqrt(2 * dt))[:, None], longer, axis=0)[:n])
