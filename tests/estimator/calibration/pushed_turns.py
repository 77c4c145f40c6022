"""Turns pushed by hand, some past the end of a gyro's range: a simulator that shares no code with the estimator.

A turn of 360° about a fixed, slightly tilted axis, in one to four pushes of six shapes, with a hand's unevenness; readings are
cut off at the range and rounded to its step. Good sessions stay below 90 % of the range.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.recording import Recording

Floats = NDArray[np.float64]
RATE_HZ = 104.0
#: how fast a push goes, from 0 to 1 of the time it takes
SHAPES = {
    "minimum jerk": lambda u: (u * (1 - u)) ** 2,
    "half sine": lambda u: np.sin(np.pi * u),
    "triangle": lambda u: np.minimum(u, 1 - u),
    "trapezoid": lambda u: np.clip(5 * np.minimum(u, 1 - u), 0, 1),
    "flat top": lambda u: 1 - (2 * u - 1) ** 8,
    "shove": lambda u: np.minimum(8 * u, 1) * np.exp(-3 * u) * np.minimum(1, 8 * (1 - u)),
}


@dataclass(frozen=True, slots=True)
class Case:
    """Sessions of one kind: range_dps of the gyro, whether turns go past it, and its noise."""

    range_dps: float
    cut: bool
    noise_dps: float


def turn(rng: np.random.Generator, shape: str, case: Case) -> Floats:
    """(n,) °/s of a turn of 360°: its fastest moment is 1.05 to 2 ranges where it is cut, else below 225 °/s, in 8 s at most."""
    pushes = int(rng.integers(1, 5))
    share = rng.uniform(0.8, 1.2, pushes)
    share /= share.sum()
    u = (np.arange(4000) + 0.5) / 4000
    form = SHAPES[shape](u)
    slowest = 360.0 * share.max() / (form.mean() / form.max())  # °/s, the fastest moment of a push of 1 s
    peak = case.range_dps * rng.uniform(1.05, 2.0) if case.cut else min(slowest / rng.uniform(2.0, 8.0) * pushes, 225.0)
    duration = slowest / peak
    pieces = []
    for part in share:
        at = np.arange(max(int(duration * RATE_HZ * part / share.max()), 12)) + 0.5
        at /= len(at)
        rate = SHAPES[shape](at)
        waves = sum(rng.normal(0, 0.01) * np.sin(2 * np.pi * f * at + rng.uniform(0, 6)) for f in range(1, 5))
        rate = rate * (1 + waves)
        pieces += [rate * 360.0 * part * RATE_HZ / rate.sum(), np.zeros(int(rng.uniform(0.1, 0.5) * RATE_HZ))]
    return np.concatenate(pieces[:-1])


def session(seed: int, shape: str, case: Case) -> tuple[Recording, Floats]:
    """A recording without an accelerometer, and its scale factors (3,)."""
    rng = np.random.default_rng(seed)
    k, bias = rng.uniform(0.95, 1.05, 3), rng.uniform(-3, 3, 3)
    rest = np.zeros((int(3 * RATE_HZ), 3))
    pieces = [rest]
    for axis in rng.permutation(3):
        about = rng.normal(0, 0.02, 3)
        about[axis] = rng.choice([-1.0, 1.0])
        pieces += [turn(rng, shape, case)[:, None] * about / np.linalg.norm(about), rest]
    rate = np.concatenate(pieces)
    step = case.range_dps / 32768
    read = np.clip(rate / k + bias + rng.normal(0, case.noise_dps, rate.shape), -case.range_dps, case.range_dps - step)
    gyro = np.radians(step * np.round(read / step)).astype(np.float32).astype(float)
    time = np.arange(1, len(gyro) + 1) / RATE_HZ
    return Recording(time, gyro, None, None, RATE_HZ, "simulated"), k
