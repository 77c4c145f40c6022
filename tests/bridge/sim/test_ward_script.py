"""A virtual device on a ward: calibrated by hand, then worn as a body is, exactly and however it is cut."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bridge.sim.motion import TrueMotion
from bridge.sim.ward_script import ward_script

RATE_HZ = 52.0


def times(seconds: float) -> NDArray[np.float64]:
    return np.arange(1, int(seconds * RATE_HZ) + 1) / RATE_HZ


def lived(seed: int, seconds: float, cuts: tuple[int, ...] = ()) -> TrueMotion:
    life, time_s = ward_script(np.random.default_rng(seed)), times(seconds)
    parts = [life.advance(time_s[a:b]) for a, b in pairwise([0, *cuts, len(time_s)])]
    return TrueMotion(
        *(np.concatenate([getattr(p, n) for p in parts]) for n in ("time_s", "rate", "attitude", "force"))
    )


def test_however_it_is_cut_it_is_the_same_life() -> None:
    whole, parts = lived(3, 120), lived(3, 120, (1, 2, 1400, 1401, 1500))
    for name in ("rate", "attitude", "force"):
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), atol=1e-9)
