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


def test_a_bridge_whose_clock_is_set_back_is_not_late() -> None:
    """It was for two minutes: an hour longer under way than anything before."""
    lateness, of = Lateness(), made(0, 5)

    def lives(at_s: float, held_s: float = 0.05) -> bool:
        ticks = of.ticks + np.uint64(round(at_s / (of.tick_period_s * of.clock_rate)))
        set_s = 3600.0 if 10.0 <= at_s < 14.0 else 0.0
        one = replace(of, ticks=ticks, start_time_ns=round((BEGUN_S + at_s + set_s) * 1e9))
        return bool((lateness.marked(one, BEGUN_S + at_s + 0.4 + held_s).flags & SampleFlag.LATE).any())

    assert not any(lives(at_s) for at_s in np.arange(0.0, 20.0, 0.4))
    assert [lives(at_s, 23.0 - at_s) for at_s in (20.0, 20.4)] == [True] * 2, "what is held up is"


@pytest.mark.parametrize("begun_s", [0.0, 12.0], ids=["begun before", "begun meanwhile"])
def test_a_device_that_reboots_when_the_clock_was_set_back_is_not_late(begun_s: float) -> None:
    """Of its boot until then the bridge still reckoned with the hour; all of the next was late for two minutes."""
    lateness = Lateness()
    assert not any(_lives(lateness, at_s, 1) for at_s in np.arange(begun_s))
    assert not any(_lives(lateness, at_s, 2, 3600.0) for at_s in np.arange(begun_s, 20.0))
    assert not any(_lives(lateness, at_s, 3) for at_s in np.arange(20.0, 30.0))
    assert _lives(lateness, 30.0, 3, held_s=3.0)


def test_an_old_boot_from_a_cache_is_late_and_the_running_one_is_not() -> None:
    """It was heard beyond a cut only, by an estimator that has kept it since."""
    lateness, came_s = Lateness(), 100.0

    def one(at_s: float, boot: int, epoch: int, came_s: float) -> bool:
        marked = lateness.marked(replace(batch(at_s), boot=boot, epoch=epoch), BEGUN_S + came_s)
        return bool((marked.flags & SampleFlag.LATE).all())

    assert not any(one(at_s, 2, 9, at_s + 0.45) for at_s in (95.0, 96.0, 97.0, 98.0, 99.0))
    assert all(one(at_s, 1, 5, came_s) for at_s in (20.0, 20.5, 21.0))
    assert not one(100.0, 2, 9, came_s + 0.45)


def test_who_slept_is_late_although_the_device_was_rebooted_meanwhile() -> None:
    """What waited in front of who slept for ten minutes."""
    lateness = Lateness()
    assert not any(_lives(lateness, at_s, 1) for at_s in range(10))
    assert all(_lives(lateness, at_s, 1 + (at_s > 12), held_s=600.0 - at_s) for at_s in range(10, 16))
    assert not _lives(lateness, 600.0, 2)


def _lives(lateness: Lateness, at_s: float, boot: int, set_s: float = 0.0, held_s: float = 0.05) -> bool:
    one = replace(batch(at_s + set_s), boot=boot)
    ticks = one.ticks + np.uint64(round(at_s / (one.tick_period_s * one.clock_rate)))
    flags = lateness.marked(replace(one, ticks=ticks), BEGUN_S + at_s + 0.4 + held_s).flags
    return bool((flags & SampleFlag.LATE).any())


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


def lates(lateness: Lateness, *came: tuple[float, int, int]) -> list[bool]:
    """Whether batches (at_s, boot, epoch), each given 50 ms after its beginning, are flagged."""
    found = []
    for at_s, boot, epoch in came:
        one = lateness.marked(replace(batch(at_s), boot=boot, epoch=epoch), BEGUN_S + at_s + 0.45)
        found.append(bool((one.flags & SampleFlag.LATE).all()))
    return found


def test_what_waited_while_the_next_boot_began_is_late() -> None:
    assert lates(Lateness(), (0, 1, 0), (1, 2, 0), (1.1, 1, 0), (1.2, 2, 0), (1.3, 1, 0)) == [0, 0, 1, 0, 1]


def test_what_waited_while_a_later_turn_began_is_late() -> None:
    assert lates(Lateness(), (0, 1, 5), (1, 1, 6), (1.1, 1, 5), (1.2, 1, 6)) == [0, 0, 1, 0]


def test_a_boot_has_turns_of_its_own() -> None:
    assert lates(Lateness(), (0, 1, 5), (1, 2, 3), (2, 2, 3)) == [0, 0, 0]


@pytest.mark.parametrize("earlier", [(1, 0), (2, 4)], ids=["boot", "turn"])
def test_what_is_heard_no_more_is_not_the_latest_for_ever(earlier: tuple[int, int]) -> None:
    came = [(at_s, *earlier) for at_s in (1.0, 5.9, 6.1, 7.0)]
    assert lates(Lateness(), (0, 1, 0), (1, 2, 9), *came) == [0, 0, 1, 1, 0, 0]


def test_the_end_of_a_boot_that_is_over_from_a_cache_does_not_make_the_running_one_late() -> None:
    lateness = Lateness()
    assert lates(lateness, (20, 2, 0)) == [0]
    assert (lateness.marked(replace(batch(15.0), boot=1), BEGUN_S + 20.5).flags & SampleFlag.LATE).all()
    assert lates(lateness, (21, 2, 0)) == [0]


def test_what_waited_of_a_boot_while_the_one_that_was_heard_first_began_is_late() -> None:
    lateness = Lateness()
    assert lates(lateness, (10.3, 2, 0)) == [0]
    assert (lateness.marked(replace(batch(10.0), boot=1), BEGUN_S + 10.8).flags & SampleFlag.LATE).all()
    assert lates(lateness, (10.5, 2, 0)) == [0]


def test_what_comes_late_of_another_boot_after_a_silence_does_not_make_the_running_one_late() -> None:
    lateness = Lateness()
    assert lates(lateness, (0, 1, 0), (1, 2, 0)) == [0, 0]
    for at_s in (7.0, 8.0):
        old = lateness.marked(replace(batch(0.5), boot=1), BEGUN_S + at_s)
        assert (old.flags & SampleFlag.LATE).all()
    assert lates(lateness, (8.1, 2, 0), (9, 2, 0)) == [0, 0]
