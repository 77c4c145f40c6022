"""Gyro bias in each movement of a session, from the rests before and after it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.calibration.capture import Floats, Rest


@dataclass(frozen=True, slots=True, eq=False)
class Biases:
    """Bias of a session and of each of its m movements, rad/s, from its n rests; variances in (rad/s)².

    mean (3,): bias of the session. noise (n, 3): variance of each rest's reading. moved (3,): variance of the bias
    about its mean. at_rest (n, 3), local (m, 3): bias in each rest and each movement, less the mean. by_reading (m + 1,
    n, 3): weights of the rests' readings in the bias of each movement and, in the last row, in the mean.
    """

    mean: Floats
    noise: Floats
    moved: Floats
    at_rest: Floats
    local: Floats
    by_reading: Floats

    @property
    def mean_moved(self) -> Floats:
        """Variance (3,), (rad/s)², of the session's mean bias that comes from the bias moving between rests."""
        return np.asarray(self.moved * np.sum(self.by_reading[-1] ** 2, axis=0))


def biases(rests: Sequence[Rest], links: Sequence[tuple[int, int]], floor: float) -> Biases:
    """Estimate the bias of each movement; links (m, 2) are the numbers of the rests before and after it.

    The more the rests scatter beyond their noise, the more weight is on the two rests beside a movement; otherwise all
    rests weigh alike. floor: rad/s, standard deviation of a rest's reading beyond its noise.
    """
    reading = np.array([rest.bias for rest in rests])
    noise = np.array([np.diag(rest.bias_cov) for rest in rests]) + floor**2
    weight = 1 / noise
    mean = (weight * reading).sum(axis=0) / weight.sum(axis=0)
    scatter = (weight * (reading - mean) ** 2).sum(axis=0) - (len(reading) - 1)
    moved = np.maximum(scatter, 0.0) / weight.sum(axis=0)
    var = noise + moved
    of_mean = (1 / var) / (1 / var).sum(axis=0)
    # (n, n, 3) weights of all readings in the bias at each rest
    own = np.eye(len(reading))[:, :, None]
    of_rest = of_mean + (moved / var)[:, None] * (own - of_mean)
    by_reading = np.array([*((of_rest[a] + of_rest[b]) / 2 for a, b in links), of_mean])
    found = np.einsum("mnk,nk->mk", by_reading, reading)
    at_rest = np.einsum("mnk,nk->mk", of_rest, reading) - found[-1]
    return Biases(found[-1], noise, moved, at_rest, found[:-1] - found[-1], by_reading)
