"""A reading alone far from its neighbours, wherever it falls: mended before anything is judged or calibrated by it."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.stillness import Stillness, Window

Floats = NDArray[np.float64]
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
@pytest.mark.parametrize("place", range(60, 60 + 3 * 14))
def test_a_lone_spike_is_mended_wherever_it_is_and_the_window_is_still(
    size: float, axes: list[int], place: int
) -> None:
    gyro = quiet()
    spiked = gyro.copy()
    spiked[place, axes] += size
    found = windows(spiked)
    assert [w.spikes for w in found if w.spikes] == [1]
    assert all(w.still for w in found)
    readings = np.concatenate([w.gyro for w in found])
    np.testing.assert_allclose(readings[place, axes], (gyro[place - 1, axes] + gyro[place + 1, axes]) / 2)
    others = np.delete(np.arange(len(readings)), place)
    np.testing.assert_array_equal(readings[others], gyro[others])
    one_by_one = windows(spiked, edges=tuple(range(1, N)))
    np.testing.assert_array_equal(np.concatenate([w.gyro for w in one_by_one]), readings)
    assert [w.end for w in one_by_one] == [w.end for w in found]


def test_one_that_was_mended_is_no_longer_clipped() -> None:
    spiked, clipped = quiet(), np.zeros(N, bool)
    spiked[100] = 35.0
    clipped[[100, 150]] = True
    found = windows(spiked, clipped)
    assert np.flatnonzero(np.concatenate([w.clipped for w in found])).tolist() == [150]


@pytest.mark.parametrize("place", range(60, 74))
def test_two_in_a_row_are_no_spike(place: int) -> None:
    gyro = quiet()
    gyro[place : place + 2, 1] = 35.0
    found = windows(gyro)
    assert not any(w.spikes for w in found)
    assert not all(w.still for w in found)
    np.testing.assert_array_equal(np.concatenate([w.gyro for w in found]), gyro[: found[-1].end])


def test_the_rough_of_a_movement_is_not_smoothed() -> None:
    rough = np.radians(200.0) * np.random.default_rng(1).normal(size=(N, 3))
    assert not any(w.spikes for w in windows(rough))


def test_a_tap_is_felt() -> None:
    gyro = quiet()
    gyro[100] += np.radians(140.0)  # in one reading at 286 Hz, the hardest of BROAD's trial 24
    found = windows(gyro)
    assert not any(w.spikes for w in found)
    assert not all(w.still for w in found)


def test_a_turn_that_begins_at_once_is_none() -> None:
    gyro = quiet()
    gyro[100:, 2] += np.radians(300.0)
    assert not any(w.spikes for w in windows(gyro))


def test_behind_a_gap_a_reading_has_no_neighbour() -> None:
    gyro, time = quiet(), np.arange(1, N + 1) / RATE_HZ
    edge = windows(gyro)[4].end
    gyro[edge] += np.radians(300.0)
    time[edge:] += 3.0
    assert not any(w.spikes for w in Stillness().feed(time, gyro, None))
