"""A reading alone far from its neighbours, wherever it falls: mended before anything is judged or calibrated by it."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.samples.sample_buffer import GYRO, Floats
from estimator.stillness.detector import Stillness, Window

RATE_HZ, N = 104.0, 208


def quiet(seed: int = 0) -> Floats:
    return np.asarray(np.random.default_rng(seed).normal(0.0, 5e-4, (N, 3)))


def windows(gyro: Floats, clipped: NDArray[np.bool_] | None = None, edges: tuple[int, ...] = ()) -> list[Window]:
    stillness, time = Stillness(), np.arange(1, len(gyro) + 1) / RATE_HZ
    bounds = (0, *edges, len(gyro))
    parts = [slice(a, b) for a, b in pairwise(bounds)]
    return [
        w
        for part in parts
        for w in stillness.feed(time[part], gyro[part], None, None if clipped is None else clipped[part])
    ]


@pytest.mark.parametrize("size", [35.0, -35.0, 4.0])
@pytest.mark.parametrize("axes", [[1], [0, 1, 2]])
@pytest.mark.parametrize("place", range(60, 74))
def test_a_lone_spike_is_mended_wherever_it_is_and_the_window_is_still(
    size: float, axes: list[int], place: int
) -> None:
    gyro = quiet()
    spiked = gyro.copy()
    spiked[place, axes] += size
    found = windows(spiked)
    assert [w.spikes for w in found if w.spikes] == [1]
    assert all(w.still for w in found)
    readings = np.concatenate([w.rows[:, GYRO] for w in found])
    np.testing.assert_allclose(readings[place, axes], (gyro[place - 1, axes] + gyro[place + 1, axes]) / 2)
    others = np.delete(np.arange(len(readings)), place)
    np.testing.assert_array_equal(readings[others], gyro[others])
    one_by_one = windows(spiked, edges=tuple(range(1, N)))
    np.testing.assert_array_equal(np.concatenate([w.rows[:, GYRO] for w in one_by_one]), readings)
    assert [w.end for w in one_by_one] == [w.end for w in found]


@pytest.mark.parametrize("place", range(60, 74))
def test_two_in_a_row_are_no_spike(place: int) -> None:
    gyro = quiet()
    gyro[place : place + 2, 1] = 35.0
    found = windows(gyro)
    assert not any(w.spikes for w in found)
    assert not all(w.still for w in found)
    np.testing.assert_array_equal(np.concatenate([w.rows[:, GYRO] for w in found]), gyro[: found[-1].end])
