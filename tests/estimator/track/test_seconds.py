"""How a stream is cut into seconds, and what is wrong with some of them."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.stillness import Window
from estimator.track.seconds import Second, SecondKnobs, Seconds

Floats = NDArray[np.float64]
RATE_HZ, NOISE = 100.0, np.full(3, 5e-4)
WINDOW = 10


def fed(
    gyro: Floats, still: list[bool], *, clipped: int | None = None, silent: tuple[int, float] | None = None
) -> Seconds:
    """Seconds that hold all samples; `windows` are as long as `still`. silent: a sample that comes so much later."""
    time = np.arange(1, len(gyro) + 1) / RATE_HZ
    if silent is not None:
        time[silent[0] :] += silent[1]
    flags = np.zeros(len(gyro), bool)
    if clipped is not None:
        flags[clipped] = True
    seconds = Seconds()
    seconds.add(time, gyro, None, flags)
    return seconds


def cut(gyro: Floats, still: list[bool], noise_std: Floats = NOISE, **damage: object) -> tuple[list[Second], Seconds]:
    seconds = fed(gyro, still, **damage)  # type: ignore[arg-type]
    time = np.concatenate([sample[0] for sample in seconds._samples])
    found = []
    for i, quiet in enumerate(still):
        a, b = i * WINDOW, (i + 1) * WINDOW
        mean, std = gyro[a:b].mean(axis=0), gyro[a:b].std(axis=0)
        window = Window(a, b, float(time[a]), float(time[b - 1]), mean, std, None, None, quiet)
        found += list(seconds.window(window, noise_std))
    return found, seconds


def noise(windows: int) -> Floats:
    return np.random.default_rng(0).normal(0.0, NOISE, (windows * WINDOW, 3))


def test_a_second_lasts_a_second_and_none_is_lost_between() -> None:
    gyro = noise(50)
    found, _ = cut(gyro, [True] * 50)
    assert len(found) == 4
    assert all(s.end - s.start == pytest.approx(1.0, abs=0.11) for s in found)
    assert [s.start for s in found[1:]] == [s.end for s in found[:-1]]
    n = sum(map(len, found))
    np.testing.assert_array_equal(np.concatenate([s.gyro for s in found]), gyro[:n])
    np.testing.assert_allclose(found[1].mean, found[1].gyro.mean(axis=0))
    assert all(s.still and s.flaw == "" for s in found)
    assert found[0].dt.sum() == pytest.approx(found[0].end - found[0].start)


def test_a_change_ends_a_second_early_and_what_is_next_to_it_is_not_still() -> None:
    found, _ = cut(noise(60), [True] * 27 + [False] * 20 + [True] * 13)
    lengths = [round(s.end - s.start, 6) for s in found]
    assert min(lengths) < 0.9 < max(lengths)
    moved_from, moved_to, settle = 2.7, 4.7, SecondKnobs().settle_s
    for s in found:
        if s.still:
            assert s.end <= moved_from - settle + 0.11 or s.start >= moved_to + settle - 0.11
    assert any(s.still for s in found)
    assert sum(not s.still for s in found) >= 2


@pytest.mark.parametrize("place", [0, 1, 150, 199, 210, 219, 220])
@pytest.mark.parametrize("size", [20.0, -20.0])
def test_a_lone_spike_is_mended_and_counted_wherever_it_is(place: int, size: float) -> None:
    gyro = noise(50)
    spiked = gyro.copy()
    spiked[place, 1] += size
    found, seconds = cut(spiked, [True] * 50)
    mended = np.concatenate([s.gyro for s in found])
    if place == 0:
        return  # the very first has one neighbour only
    assert seconds.refused.as_dict() == {"spike": 1}
    np.testing.assert_allclose(mended[place, 1], (gyro[place - 1, 1] + gyro[place + 1, 1]) / 2)
    others = np.delete(np.arange(len(mended)), place)
    np.testing.assert_array_equal(mended[others], gyro[others])


@pytest.mark.parametrize("damage", [{"clipped": 150}, {"silent": (150, 0.3)}])
def test_a_second_with_a_clipped_reading_or_a_hole_is_flawed_and_no_other(damage: dict[str, object]) -> None:
    found, _ = cut(noise(50), [True] * 50, **damage)  # type: ignore[arg-type]
    assert [s.flaw for s in found if s.flaw] == ["clipped" if "clipped" in damage else "gap"]
    assert found[1].flaw


def test_a_short_silence_hides_nothing() -> None:
    found, _ = cut(noise(50), [True] * 50, silent=(150, 0.2))
    assert not any(s.flaw for s in found)


def test_an_axis_that_repeats_itself_is_stuck_unless_it_is_coarse() -> None:
    gyro = 20 * noise(50)
    gyro[:, 2] = 1e-3
    assert {s.flaw for s in cut(gyro, [True] * 50, noise_std=np.full(3, 1.0))[0]} == {"stuck"}
    step = 0.01
    coarse = np.round(noise(50) / step) * step
    assert {s.flaw for s in cut(coarse, [True] * 50)[0]} == {""}


def test_skipped_windows_go_by() -> None:
    gyro = noise(30)
    seconds = fed(gyro, [])
    first = Window(0, WINDOW, 0.01, 0.1, gyro[0], NOISE, None, None, still=True)
    seconds.skip(first)
    window = replace(first, start=WINDOW, end=2 * WINDOW, start_time=0.11, end_time=0.2)
    assert list(seconds.window(window, NOISE)) == []
    np.testing.assert_array_equal(np.concatenate([s[1] for s in seconds._samples]), gyro[WINDOW:])
