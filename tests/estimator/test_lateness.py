"""Late is what took much longer than the others, whatever the clocks say."""

from dataclasses import replace

import numpy as np
import pytest

from bridge.wire.messages import CorrectedBatch, SampleFlag
from estimator.lateness import Lateness
from tests.estimator.test_revision import batch as made

BEGUN_S = 1_700_000_000.0


def batch(at_s: float) -> CorrectedBatch:
    return replace(made(0, 5), start_time_ns=round((BEGUN_S + at_s) * 1e9))


def late(lateness: Lateness, at_s: float, comes_s: float) -> bool:
    flags = lateness.marked(batch(at_s), BEGUN_S + comes_s).flags & SampleFlag.LATE
    assert len(np.unique(flags)) == 1
    return bool(flags[0])


@pytest.mark.parametrize("apart_s", [0.0, 0.4, -20.0])
def test_what_was_held_up_is_late_and_what_follows_it_is_not(apart_s: float) -> None:
    lateness = Lateness()
    assert [late(lateness, at_s, at_s + apart_s + 0.05) for at_s in np.arange(10.0)] == [False] * 10
    assert [late(lateness, at_s, 14.0 + apart_s) for at_s in (10.0, 11.0, 12.0)] == [True] * 3
    assert not late(lateness, 14.0, 14.05 + apart_s)


def test_what_is_kept_for_who_joins_is_late() -> None:
    assert [late(Lateness(), at_s, 15.0) for at_s in (0.0, 13.0, 14.9)] == [True, True, False]


def test_a_clock_that_is_ahead_is_known_after_two_minutes() -> None:
    lateness = Lateness()
    found = [late(lateness, at_s, at_s + 5.0) for at_s in np.arange(0.0, 300.0)]
    assert found[0]
    assert not any(found[125:])
    assert late(lateness, 300.0, 307.0)


def test_a_recording_is_of_another_time() -> None:
    lateness = Lateness()
    assert not any(late(lateness, at_s, at_s + 1e7) for at_s in range(10))


def test_flags_that_were_there_stay() -> None:
    one = batch(0.0)
    one = replace(one, flags=one.flags | np.uint32(SampleFlag.CLIPPED))
    assert (Lateness().marked(one, BEGUN_S + 5.0).flags == SampleFlag.CLIPPED | SampleFlag.LATE).all()


def test_of_a_long_batch_only_what_is_late_is_marked() -> None:
    """As a bridge makes one of what it could not send: it ends when it comes, and began 1.5 s before."""
    lateness = Lateness()
    assert not late(lateness, 0.0, 0.45), "five samples last 0.4 s"
    one = made(0, 151)
    lasts_s = int(one.ticks[-1] - one.ticks[0]) * one.tick_period_s * one.clock_rate
    marked = lateness.marked(replace(one, start_time_ns=round((BEGUN_S + 1.0) * 1e9)), BEGUN_S + 1.07 + lasts_s)
    flags = (marked.flags & SampleFlag.LATE) != 0
    at_s = (one.ticks - one.ticks[0]).astype(float) * one.tick_period_s * one.clock_rate
    assert lasts_s > 1.2
    np.testing.assert_array_equal(flags, lasts_s - at_s + 0.02 > 1.0)
    assert 0 < np.count_nonzero(flags) < len(flags)
