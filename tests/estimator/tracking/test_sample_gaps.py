"""Batches that are lost in a movement: nobody saw how the device turned meanwhile, and the bias is not what explains it."""

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.sim.motion import Still
from bridge.sim.motion_scripts import swing
from estimator.tracking.sample_gaps import unseen
from estimator.tracking.seconds import GAP_S
from tests.estimator.stream import Stream, stream
from tests.estimator.tracking.worn import LEVEL, PLAIN, Worn, model

BATCH = 10


def lossy(day: Stream, share: float, seed: int) -> Stream:
    """Without that share of its batches, lost one or two in a row: too short a silence for a gap."""
    rng = np.random.default_rng(seed)
    lost = rng.random(len(day) // BATCH + 1) < share
    lost[2:] &= ~(lost[1:-1] & lost[:-2])
    return day.only(np.flatnonzero(~lost[np.arange(len(day)) // BATCH]))


def lively(seed: int) -> Stream:
    """Swung and put down again and again, by a hand that never waits long."""
    rng = np.random.default_rng(seed)
    pieces = [piece for _ in range(4) for piece in (swing(rng, 4.0, np.radians(120.0)), Still(3.0))]
    return stream(pieces, sum(p.duration_s for p in pieces), seed=seed, spec=PLAIN, attitude=LEVEL)


@pytest.mark.parametrize("share", [0.05, 0.15])
def test_batches_lost_in_movements_do_not_mislead_the_bias(share: float) -> None:
    """Sure of 0.03 °/s it was off by 0.3: after the movement gravity was not where the readings that came had turned it."""
    worst = 0.0
    for seed in range(12):
        day = lossy(lively(seed), share, seed)
        assert 0.09 < np.diff(day.time).max() < GAP_S
        begin = day.bias[0] + np.radians(0.2) * np.random.default_rng(seed).normal(size=3)
        worn = Worn.new(bias_std_dps=0.2, gyro=model(begin, 1e-2, 1e-2)).lives(day)
        off = np.abs(np.array(worn.bias) - day.bias[-1])
        worst = max(worst, float((off / np.array(worn.std)).max()))
    assert worst < 4.0


def turned(rate: NDArray[np.float64], time: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) the way turned, each reading held since the one before."""
    return np.asarray(np.diff(time, prepend=0.0) @ rate)


def test_what_a_hole_hides_is_told_within_reason() -> None:
    rng, time = np.random.default_rng(0), np.arange(1, 101) / 100
    off, told = [], []
    for _ in range(300):
        rate = np.sin(2 * np.pi * rng.uniform(0.5, 2.0, 3) * time[:, None] + rng.uniform(0, 7, 3))
        first, missing = rng.integers(0, 80), rng.integers(1, 15)
        heard = np.r_[0:first, first + missing : 100]
        off.append(turned(rate[heard], time[heard]) - turned(rate, time))
        told.append(unseen(np.diff(time[heard], prepend=0.0), rate[heard], rate[0]))
    z = np.linalg.norm(off, axis=1) / told
    assert 0.3 < np.sqrt(np.mean(z**2)) < 1.2
    assert np.max(z) < 3.0
