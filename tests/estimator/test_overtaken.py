"""Batches that come before their turn."""

from math import inf

import numpy as np
import pytest

from estimator.device.samples import Samples
from estimator.overtaken import WAIT_S, WINDOW, Overtaken
from tests.estimator.stream import stream


@pytest.fixture(scope="module")
def batches() -> list[Samples]:
    return [Samples.of(batch) for batch in stream([], 40.0).batches()]


def fed(overtaken: Overtaken, batches: list[Samples], now: float = 0.0, awaited: int | None = None) -> list[int]:
    """Their numbers in the order in which they are given; who takes them counts on."""
    given: list[int] = []
    for batch in batches:
        for ready in overtaken.feed(batch, awaited, now):
            given.append(ready.sequence)
            awaited = max(awaited or 0, ready.sequence + ready.n)
    return given


def test_what_is_in_order_does_not_wait(batches: list[Samples]) -> None:
    overtaken = Overtaken()
    assert fed(overtaken, batches[:5]) == [0, 10, 20, 30, 40]
    assert not overtaken


def test_a_hole_that_is_filled_lets_the_others_through(batches: list[Samples]) -> None:
    overtaken = Overtaken()
    a, b, c, d = batches[:4]
    assert fed(overtaken, [a, c, d, c]) == [0]
    assert (bool(overtaken), overtaken.samples) == (True, 30)
    assert fed(overtaken, [b], awaited=10) == [10, 20, 20, 30]
    assert (bool(overtaken), overtaken.samples) == (False, 0)


def test_a_hole_is_waited_for_only_so_long(batches: list[Samples]) -> None:
    overtaken = Overtaken()
    assert fed(overtaken, [batches[3]], 1.0, awaited=10) == []
    assert fed(overtaken, [batches[7]], 1.05, awaited=10) == []
    assert overtaken.overdue(1.0 + 0.9 * WAIT_S) == []
    assert [b.sequence for b in overtaken.overdue(1.001 + WAIT_S)] == [30]
    assert [b.sequence for b in overtaken.overdue(inf)] == [70]


def test_no_more_is_held_than_fits(batches: list[Samples]) -> None:
    overtaken = Overtaken()
    n = WINDOW // 10
    assert fed(overtaken, batches[2 : 2 + n], awaited=10) == []
    assert fed(overtaken, [batches[2 + n]], awaited=10) == [10 * (2 + i) for i in range(n + 1)]


def test_the_first_of_a_boot_waits_unless_it_is_the_first_there_can_be(batches: list[Samples]) -> None:
    assert fed(Overtaken(), [batches[1], batches[0]]) == [0, 10]
    assert fed(Overtaken(10), [batches[1]]) == [10], "a session that failed knows where it was"


def test_nothing_is_lost_whatever_the_order(batches: list[Samples]) -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        order = rng.integers(0, 30, 60)
        overtaken = Overtaken()
        given = fed(overtaken, [batches[i] for i in order])
        given += [b.sequence for b in overtaken.drop()]
        assert sorted(given) == sorted(10 * order)
        assert overtaken.samples == 0
