"""Batches that come before their turn."""

from math import inf

import numpy as np
import pytest

from estimator.device.admission import WAIT_S, WINDOW, EarlyBatches
from estimator.samples.sample_buffer import Samples
from tests.estimator.stream import stream


@pytest.fixture(scope="module")
def batches() -> list[Samples]:
    return [Samples.of(batch) for batch in stream([], 40.0).batches()]


def fed(buffer: EarlyBatches, batches: list[Samples], now: float = 0.0, awaited: int | None = None) -> list[int]:
    """Their numbers in the order in which they are given; who takes them counts on."""
    given: list[int] = []
    for batch in batches:
        for ready in buffer.feed(batch, awaited, now):
            given.append(ready.sequence)
            awaited = max(awaited or 0, ready.sequence + ready.n)
    return given


def test_a_hole_is_waited_for_only_so_long(batches: list[Samples]) -> None:
    buffer = EarlyBatches()
    assert fed(buffer, [batches[3]], 1.0, awaited=10) == []
    assert fed(buffer, [batches[7]], 1.05, awaited=10) == []
    assert buffer.overdue(1.0 + 0.9 * WAIT_S) == []
    assert [b.sequence for b in buffer.overdue(1.001 + WAIT_S)] == [30]
    assert [b.sequence for b in buffer.overdue(inf)] == [70]


def test_no_more_is_held_than_fits(batches: list[Samples]) -> None:
    buffer = EarlyBatches()
    n = WINDOW // 10
    assert fed(buffer, batches[2 : 2 + n], awaited=10) == []
    assert fed(buffer, [batches[2 + n]], awaited=10) == [10 * (2 + i) for i in range(n + 1)]


def test_the_first_of_a_boot_waits_unless_it_is_the_first_there_can_be(batches: list[Samples]) -> None:
    assert fed(EarlyBatches(), [batches[1], batches[0]]) == [0, 10]
    assert fed(EarlyBatches(10), [batches[1]]) == [10], "a session that failed knows where it was"


def test_nothing_is_lost_whatever_the_order(batches: list[Samples]) -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        order = rng.integers(0, 30, 60)
        buffer = EarlyBatches()
        given = fed(buffer, [batches[i] for i in order])
        given += [b.sequence for b in buffer.drop()]
        assert sorted(given) == sorted(10 * order)
        assert buffer.samples == 0
