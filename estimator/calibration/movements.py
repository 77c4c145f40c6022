"""Selection of the movements that can be used to propagate gravity by the gyro, and the gyro's bias in each of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.calibration.capture import Floats, Movement, Rest
from estimator.calibration.clipping import clipped
from estimator.calibration.turn_recognition import GAP_S, same_bias

#: number of movements kept: more than any procedure needs, 20 MB at 1 kHz
MOST = 64
#: s, longest movement kept: the error of its angle is that of the bias times its duration
LONGEST_S = 30.0
#: rad, largest total rotation kept: more means two movements with an unrecognised rest between, which may hide errors
LONGEST_WAY = 1.5 * 2 * np.pi
#: s; movements this much older than the newest, or at a different bias, are not combined with it
STALE_S = 600.0


class Movements:
    """Collection of the latest movements between rests, at most 64, as input of a calibration by movements.

    gyro_range: full-scale range, rad/s; infinite when unknown.
    """

    def __init__(self, gyro_range: float) -> None:
        self._gyro_range = gyro_range
        #: all kept movements in the order of time
        self.kept: list[Movement] = []

    def add(self, movement: Movement, *, full_turn: bool) -> bool:
        """Keep a movement if the gyro can propagate gravity through it; return True if it was kept.

        full_turn: True if the movement is known to have ended in its start attitude.
        A kept movement has accelerometer readings and the same bias (within noise and 0.2 °/s) at both rests. It has no
        clipped or missing samples. It lasts at most 30 s, and turns at most 540° in total.
        Earlier movements are dropped when they are 600 s older than the new one, or have another bias.
        """
        if movement.before.accel is None or movement.after.accel is None or not self._whole(movement):
            return False
        newest = movement.before
        self.kept = [
            kept
            for kept in self.kept[-(MOST - 1) :]
            if newest.end - kept.after.end < STALE_S and same_bias(kept.before, newest)
        ]
        self.kept.append(replace(movement, full_turn=full_turn))
        return True

    def _whole(self, movement: Movement) -> bool:
        time = movement.samples.time
        if (
            clipped(movement.samples, movement.before.std, self._gyro_range).any()
            or movement.after.start - movement.before.end > LONGEST_S
            or len(time) < 3
        ):
            return False
        steps = np.diff(time)
        way = np.linalg.norm(movement.samples.gyro[1:] - movement.before.bias, axis=1) @ steps
        reached = time[0] <= movement.before.end and time[-1] >= movement.after.start
        calm = same_bias(movement.before, movement.after)
        return bool(
            reached and calm and way <= LONGEST_WAY and steps.max() <= max(GAP_S, 2.5 * float(np.median(steps)))
        )


@dataclass(frozen=True, slots=True, eq=False)
class Biases:
    """Bias of a session and of each of its m movements, rad/s, from its n rests; variances in (rad/s)².

    mean (3,): bias of the session.
    noise (n, 3): variance of each rest's mean reading.
    moved (3,): variance of the bias about its mean.
    at_rest (n, 3), local (m, 3): bias in each rest and each movement, less the mean.
    by_reading (m + 1, n, 3): weights, no unit, of the rests' readings in the bias of each movement. The last row has
        their weights in the mean.
    """

    mean: Floats
    noise: Floats
    moved: Floats
    at_rest: Floats
    local: Floats
    by_reading: Floats

    @property
    def mean_moved(self) -> Floats:
        """Variance (3,), (rad/s)², of the session's mean bias from bias changes between rests."""
        return np.asarray(self.moved * np.sum(self.by_reading[-1] ** 2, axis=0))


def biases(rests: Sequence[Rest], links: Sequence[tuple[int, int]], floor: float) -> Biases:
    """Estimate the bias of each of m movements from the mean readings of n rests.

    links (m pairs): numbers of the rests before and after each movement.
    floor: standard deviation of a rest's mean reading beyond its noise, rad/s.
    Where the rests agree within their noise, the bias of every movement is their weighted mean. The more they scatter
    beyond it, the more weight is on the two rests beside a movement.
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
