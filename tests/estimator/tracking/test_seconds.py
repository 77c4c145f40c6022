"""How a stream is cut into seconds, and what is wrong with some of them."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.stillness.detector import Windows
from estimator.tracking.seconds import Second, Seconds

Floats = NDArray[np.float64]
RATE_HZ, NOISE = 100.0, np.full(3, 5e-4)
WINDOW = 10


def cut(
    gyro: Floats,
    still: list[bool],
    noise_std: Floats = NOISE,
    *,
    clipped: int | None = None,
    silent: tuple[int, float] | None = None,
) -> tuple[list[Second], Seconds]:
    """The seconds of a stream in windows as long as `still`. silent: a sample that comes so much later."""
    time = np.arange(1, len(gyro) + 1) / RATE_HZ
    if silent is not None:
        time[silent[0] :] += silent[1]
    flags = np.zeros(len(gyro), bool)
    if clipped is not None:
        flags[clipped] = True
    seconds = Seconds()
    windows = in_windows(time, gyro, flags, still, noise_std)
    return [second for one in windows.each() for _, second in seconds.take(one)], seconds


def in_windows(time: Floats, gyro: Floats, flags: NDArray[np.bool_], still: list[bool], noise_std: Floats) -> Windows:
    """All of it, as kernels/stillness.py has it."""
    none = np.full(3, np.nan)
    found = np.array(
        [
            [
                time[b - WINDOW],
                time[b - 1],
                b,
                0,
                quiet,
                0,
                1,
                *part.mean(axis=0),
                *none,
                *part.std(axis=0),
                *none,
                *noise_std,
            ]
            for b, quiet in zip(range(WINDOW, len(gyro) + 1, WINDOW), still, strict=True)
            for part in [gyro[b - WINDOW : b]]
        ]
    )
    return Windows(
        found, np.column_stack([time, gyro, np.full_like(gyro, np.nan), flags, np.full(len(flags), np.nan)]), 0
    )


def noise(windows: int) -> Floats:
    return np.random.default_rng(0).normal(0.0, NOISE, (windows * WINDOW, 3))


def test_a_second_lasts_a_second_and_none_is_lost_between() -> None:
    gyro = noise(50)
    found, _ = cut(gyro, [True] * 50)
    assert len(found) == 4
    assert all(s.end - s.start == pytest.approx(1.0, abs=0.11) for s in found)
    assert [s.start for s in found[1:]] == [s.end for s in found[:-1]]
    n = sum(s.samples for s in found)
    np.testing.assert_array_equal(np.concatenate([s.gyro for s in found]), gyro[:n])
    np.testing.assert_allclose(found[1].mean, found[1].gyro.mean(axis=0))
    assert all(s.still and s.flaw == "" for s in found)
    assert found[0].dt.sum() == pytest.approx(found[0].end - found[0].start)


def test_a_second_of_movement_is_told_at_once_and_one_that_seems_still_waits_to_see_how_it_goes_on() -> None:
    second, settle = 11, 5
    assert len(cut(noise(second), [False] * second)[0]) == 1
    assert cut(noise(second), [True] * second)[0] == []
    quiet, _ = cut(noise(second + settle), [True] * (second + settle))
    assert [s.still for s in quiet] == [True]


@pytest.mark.parametrize("damage", [{"clipped": 150}, {"silent": (150, 0.3)}])
def test_a_second_with_a_clipped_reading_or_a_hole_is_flawed_and_no_other(damage: dict[str, object]) -> None:
    found, _ = cut(noise(50), [True] * 50, **damage)  # type: ignore[arg-type]
    assert [s.flaw for s in found if s.flaw] == ["clipped" if "clipped" in damage else "gap"]
    assert found[1].flaw


def test_an_axis_that_repeats_itself_is_stuck_unless_it_is_coarse() -> None:
    gyro = 20 * noise(50)
    gyro[:, 2] = 1e-3
    assert {s.flaw for s in cut(gyro, [True] * 50, noise_std=np.full(3, 1.0))[0]} == {"stuck"}
    step = 0.01
    coarse = np.round(noise(50) / step) * step
    assert {s.flaw for s in cut(coarse, [True] * 50)[0]} == {""}


@pytest.mark.parametrize("seed", range(20))
def test_seconds_are_the_same_however_windows_come(seed: int) -> None:
    rng = np.random.default_rng(seed)
    still = np.repeat(rng.random(40) < 0.6, rng.integers(1, 25, 40))[:200].tolist()
    gyro = noise(len(still))
    time, flags = np.arange(1, len(gyro) + 1) / RATE_HZ, np.zeros(len(gyro), bool)
    windows, one, other = in_windows(time, gyro, flags, still, NOISE), Seconds(), Seconds()
    edges = [0, *sorted(rng.integers(0, len(windows), 12).tolist()), len(windows)]
    found = [(a + at, s) for a, b in pairwise(edges) for at, s in one.take(windows.part(a, b))]
    witness = [(i, s) for i, part in enumerate(windows.each()) for _, s in other.take(part)]
    assert len(witness) > 10
    for (at, ours), (where, its) in zip(found, witness, strict=True):
        assert at == where
        assert (ours.start, ours.end, ours.still, ours.flaw) == (its.start, its.end, its.still, its.flaw)
        for name in ("dt", "gyro", "mean", "std", "noise_std"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(its, name))
