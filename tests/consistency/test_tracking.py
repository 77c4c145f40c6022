"""Is the tracker as sure of the bias as it may be? A few seeds of one scene of `tests/bench/honesty.py`, which has them all."""

from dataclasses import replace

import pytest

from tests.bench.honesty import SCENES, band, measured

SEEDS = range(60)
SCENE = SCENES["rests and movement"]


@pytest.mark.parametrize("accel", [True, False], ids=["aided", "gyro only"])
def test_it_is_as_sure_as_it_may_be(*, accel: bool) -> None:
    """At the end of the scene and on the way there."""
    score = measured(SCENE, SEEDS, accel=accel)
    low, high = band(len(SEEDS))
    assert low < score.end < high
    assert low < score.way < high


def test_told_a_walk_five_times_too_small_it_is_far_too_sure() -> None:
    """The tests above can fail."""
    assert measured(SCENE, range(20), accel=True, told=0.2).end > 4.0


def test_pauses_in_a_walk_are_no_rests() -> None:
    """Who stands for a moment sways by 0.2 °/s in what a gyro takes for rest; believed to 0.1 °/s it was far too sure."""
    score = measured(SCENES["a walk with pauses (*)"], range(16), accel=False)
    assert score.end < band(16)[1]
    assert score.way < band(16)[1]


def test_a_walker_who_goes_on_for_minutes_is_no_one_who_stays_where_he_is() -> None:
    """Each second's velocity taken for zero with an error of its own, he made a bias four times too sure at each corner."""
    score = measured(SCENES["a steady walk"], range(16), accel=True)
    low, high = band(16)
    assert low < score.end < high
    assert low < score.way < high


def test_a_new_device_that_is_turned_by_hand_is_no_surer_than_it_may_be() -> None:
    """A scale that may be off by a quarter takes gravity farther than any first order tells: NEES was 77 and 134."""
    score = measured(SCENES["turned by hand, uncalibrated (*)"], range(40), accel=True)
    assert score.end < band(40)[1]
    assert score.way < band(40)[1]
    assert score.squared < 1.5 * measured(SCENES["turned by hand, uncalibrated (*)"], range(40), accel=False).squared


@pytest.mark.parametrize("accel", [True, False], ids=["aided", "gyro only"])
def test_a_bias_that_flickers_is_within_what_is_told(*, accel: bool) -> None:
    """The worst of the kinds that come with truerate, worn; without `flicker_std` half of it, and two thirds."""
    scene = SCENES["on the ward, B 0.014 °/s (*)"]
    found = measured(scene, range(12), accel=accel)
    assert 0.9 < found.within < 0.98
    assert found.way < 2.0
    assert measured(replace(scene, unstable_dps=0.0), range(2), accel=accel).within < 0.75
