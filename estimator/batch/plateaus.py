"""Stretches of constant rate in a recording, as a turntable or a servo makes them, and the rests between."""

from dataclasses import dataclass
from math import radians

import numpy as np

from estimator.batch.capture import Floats, Samples
from estimator.gyro import least_step, mean_var


@dataclass(frozen=True, slots=True)
class PlateauKnobs:
    """What is constant. Seconds, rad/s."""

    window_s: float = 0.2
    least_s: float = 1.0
    #: a window's mean may differ from its plateau's by this, or by this share of the rate
    tolerance: float = radians(0.3)
    share: float = 0.005
    #: its readings may scatter by this many times the quietest ones', and by this share of the rate: a machine hums
    noise_factor: float = 5.0
    hum_share: float = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Plateau:
    """A stretch of constant rate: mean reading (3,) rad/s, var (3,) of that mean, std (3,) of one of its n readings.

    accel (3,) mean m/s² or None.
    """

    start: float
    end: float
    mean: Floats
    var: Floats
    std: Floats
    n: int
    accel: Floats | None

    @property
    def axis(self) -> int:
        """The sensor axis that reads most."""
        return int(np.argmax(np.abs(self.mean)))


def plateaus(samples: Samples, knobs: PlateauKnobs | None = None) -> list[Plateau]:
    """All of them in the order of time; a plateau's first and last window are cut off, for they may hold a ramp."""
    knobs = knobs or PlateauKnobs()
    step = max(round(knobs.window_s / float(np.median(np.diff(samples.time)))), 4)
    count = len(samples) // step
    if count < 3:
        return []
    windows = samples.gyro[: count * step].reshape(count, step, 3)
    mean, std = windows.mean(axis=1), windows.std(axis=1, ddof=1)
    quiet = np.maximum(np.quantile(std, 0.2, axis=0), radians(0.01))
    size = np.linalg.norm(mean, axis=1)
    calm = np.all(std <= knobs.noise_factor * quiet + knobs.hum_share * size[:, None], axis=1)
    found, first = [], 0
    for i in range(1, count + 1):
        if i < count and calm[i] and calm[first] and _same(mean[first], mean[i], knobs, quiet / np.sqrt(step)):
            continue
        if calm[first]:
            found += _plateau(samples, (first + 1) * step, (i - 1) * step, knobs)
        first = i
    return found


def _same(a: Floats, b: Floats, knobs: PlateauKnobs, noise: Floats) -> bool:
    near = knobs.tolerance + knobs.share * float(np.linalg.norm(a)) + 6 * noise
    return bool(np.all(np.abs(a - b) < near))


def _plateau(samples: Samples, start: int, end: int, knobs: PlateauKnobs) -> list[Plateau]:
    if end - start < 4 or samples.time[end - 1] - samples.time[start] < knobs.least_s:
        return []
    if samples.clipped[start:end].any():
        return []
    gyro = samples.gyro[start:end]
    accel = None if samples.accel is None else samples.accel[start:end].mean(axis=0)
    std, n = gyro.std(axis=0, ddof=1), end - start
    var = mean_var(std, least_step(gyro), n)
    return [Plateau(float(samples.time[start]), float(samples.time[end - 1]), gyro.mean(axis=0), var, std, n, accel)]


def still(plateau: Plateau, rates: tuple[float, ...]) -> bool:
    """Whether it is a rest rather than the slowest of the rates (rad/s), whatever the bias of a cheap gyro."""
    return float(np.linalg.norm(plateau.mean)) < 0.5 * min(rates)


def nearest_rates(size: Floats, rates: tuple[float, ...], k_min: float = 0.7, k_max: float = 1.4) -> Floats:
    """The known rate (n,) that each plateau of one axis was turned at, from its reading's size (n,) rad/s.

    One scale factor must explain them all; of several that do, the one nearest to 1.
    """
    known = np.array(rates)
    candidates = known / size.max()
    candidates = candidates[(candidates >= k_min) & (candidates <= k_max)]
    if not len(candidates):
        candidates = known[[np.argmin(np.abs(np.log(known / size.max())))]] / size.max()
    guesses = known[np.argmin(np.abs(candidates[:, None, None] * size[:, None] - known), axis=2)]
    misfit = np.sum((candidates[:, None] * size / guesses - 1) ** 2, axis=1)
    best = min(range(len(candidates)), key=lambda i: (round(float(misfit[i]), 3), abs(float(np.log(candidates[i])))))
    return np.asarray(guesses[best])
