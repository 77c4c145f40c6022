"""Detection of plateaus, stretches of constant rate, in a recording on a turntable or a servo; rests are plateaus too."""

from dataclasses import dataclass
from math import radians

import numpy as np

from bridge.reasons.codes import Code, Sentences
from estimator.calibration.capture import Floats, Samples
from estimator.calibration.result import K_MAX, K_MIN
from estimator.geometry.gyro_model import least_step, mean_var

#: s, length of the windows that are compared, and of the shortest plateau
_WINDOW_S, _LEAST_S = 0.2, 1.0
#: largest difference of a window's mean from its plateau's: rad/s, plus a share of the rate
_TOLERANCE, _SHARE = radians(0.3), 0.005
#: largest scatter of its readings: multiple of that of the quietest windows, plus a share of the rate for the machine's hum
_NOISE_FACTOR, _HUM_SHARE = 5.0, 0.02
#: rad/s, largest difference of a rest's mean from that of the others
_REST = radians(1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Plateau:
    """Stretch of constant rate from device time `start` to `end`, s, with its mean reading (3,) rad/s in sensor axes.

    var (3,): variance of the mean, (rad/s)².
    std (3,): standard deviation of one reading, rad/s.
    clipped: True if some readings were at the end of the range.
    """

    start: float
    end: float
    mean: Floats
    var: Floats
    std: Floats
    clipped: bool


def plateaus(samples: Samples) -> list[Plateau]:
    """Find all stretches of constant rate of at least 1 s in a recording, in the order of time; empty when there are none.

    The method compares windows of 0.2 s by mean and scatter. The first and last window of a plateau are left out,
    because they may contain a ramp.
    """
    step = max(round(_WINDOW_S / float(np.median(np.diff(samples.time)))), 4)
    n = len(samples) // step
    if n < 3:
        return []
    windows = samples.gyro[: n * step].reshape(n, step, 3)
    mean, std = windows.mean(axis=1), windows.std(axis=1, ddof=1)
    quiet = np.maximum(np.quantile(std, 0.2, axis=0), radians(0.01))
    size = np.linalg.norm(mean, axis=1)
    calm = np.all(std <= _NOISE_FACTOR * quiet + _HUM_SHARE * size[:, None], axis=1)
    found, first = [], 0
    for i in range(1, n + 1):
        if i < n and calm[i] and calm[first] and _same(mean[first], mean[i], quiet / np.sqrt(step)):
            continue
        if calm[first]:
            found += _plateau(samples, (first + 1) * step, (i - 1) * step)
        first = i
    return found


def _same(a: Floats, b: Floats, noise: Floats) -> bool:
    near = _TOLERANCE + _SHARE * float(np.linalg.norm(a)) + 6 * noise
    return bool(np.all(np.abs(a - b) < near))


def _plateau(samples: Samples, start: int, end: int) -> list[Plateau]:
    if end - start < 4 or samples.time[end - 1] - samples.time[start] < _LEAST_S:
        return []
    gyro = samples.gyro[start:end]
    std = gyro.std(axis=0, ddof=1)
    var = mean_var(std, least_step(gyro), end - start)
    clipped = bool(samples.clipped[start:end].any()) or _stuck(gyro, samples.gyro)
    return [Plateau(float(samples.time[start]), float(samples.time[end - 1]), gyro.mean(axis=0), var, std, clipped)]


def _stuck(gyro: Floats, of: Floats) -> bool:
    """Return whether an axis is stuck at the range's end in a stretch (n, 3).

    The axis then has one value only, the largest of the recording (m, 3), whose other readings differ from it.
    """
    least, most = np.abs(gyro).min(axis=0), np.abs(of).max(axis=0)
    return bool(np.any((least >= 0.999 * most) & (np.ptp(gyro, axis=0) == 0) & (np.ptp(of, axis=0) > 0.5 * most)))


def split(found: list[Plateau], rates: tuple[float, ...]) -> tuple[list[Plateau], list[Plateau], list[Plateau]]:
    """Split plateaus into three lists: rests, turns, and others.

    found: all plateaus of a recording. rates: known rates of the machine, rad/s.
    Rests are slower than 30 % of the lowest known rate, and slower than 1 °/s. Turns are faster than half of the lowest
    known rate, and not clipped. All remaining plateaus are others.
    The rates are taken relative to the median reading of each axis, which stands for the bias. This works for a bias of
    any size, because most plateaus do not rotate about any one axis.
    """
    if not found:
        return [], [], []
    mean, slowest = np.array([p.mean for p in found]), min(rates)
    slow = np.linalg.norm(mean - np.median(mean, axis=0), axis=1) < 0.5 * slowest
    centre = np.median(mean[slow] if slow.any() else mean, axis=0)
    rests, spins, others = [], [], []
    for p, size in zip(found, np.linalg.norm(mean - centre, axis=1), strict=True):
        if size < min(_REST, 0.3 * slowest):
            rests.append(p)
        elif size >= 0.5 * slowest and not p.clipped:
            spins.append(p)
        else:
            others.append(p)
    return rests, spins, others


def said_of_others(others: list[Plateau]) -> Sentences:
    """Reason text that counts the plateaus left out of a fit, and the clipped ones among them; empty if there are none."""
    clipped = sum(p.clipped for p in others)
    return (Code.STRETCHES_LEFT_OUT(stretches=len(others), clipped=clipped),) if others else ()


def nearest_rates(size: Floats, rates: tuple[float, ...]) -> Floats:
    """Assign a known rate (n,), rad/s, to each of n plateaus of one axis; 0 where no rate fits.

    size (n,): absolute reading of each plateau less the bias, rad/s.
    rates: known rates of the machine, rad/s.
    The method finds one scale factor that explains most readings within 1 %. Of several such factors it takes the one
    nearest to 1. A reading more than 10 % from every known rate under that factor gets 0.
    """
    known = np.array(rates)
    candidates = (known / size[:, None]).ravel()
    candidates = candidates[(candidates >= K_MIN) & (candidates <= K_MAX)]
    if not len(candidates):
        return np.zeros(len(size))
    guesses = known[np.argmin(np.abs(candidates[:, None, None] * size[:, None] - known), axis=2)]
    off = np.abs(candidates[:, None] * size / guesses - 1)
    explained = np.sum(off < 0.01, axis=1)
    best = min(range(len(candidates)), key=lambda i: (-explained[i], abs(float(np.log(candidates[i])))))
    return np.where(off[best] < 0.1, guesses[best], 0.0)
