"""Nothing of an older epoch after a newer one, and nobody is shut out for ever."""

import random
from dataclasses import replace
from itertools import pairwise

import numpy as np

from bridge.wire.messages import CorrectedBatch, SampleFlag
from estimator.fence import FORGET_S, Fence, Turns
from estimator.once import Once, OnceKnobs
from tests.estimator.test_revision import batch


def test_what_is_older_is_refused_after_what_is_newer() -> None:
    fence = Fence()
    assert [fence.admits("d", epoch, 0.0) for epoch in (0, 5, 5, 4, 6, 5, 6)] == [
        *(True, True, True, False, True, False, True),
    ]


def test_devices_have_nothing_to_do_with_each_other() -> None:
    fence = Fence()
    assert fence.admits("a", 9, 0.0)
    assert fence.admits("b", 1, 0.0)


def test_an_epoch_is_forgotten_when_only_older_ones_come() -> None:
    fence = Fence()
    assert fence.admits("d", 9, 0.0)
    assert [fence.admits("d", 1, now) for now in (1.0, 4.0, 1.0 + FORGET_S)] == [False] * 3
    assert fence.admits("d", 1, 1.1 + FORGET_S)
    assert fence.admits("d", 9, 1.2 + FORGET_S)


def test_it_is_not_forgotten_where_nothing_comes_for_long() -> None:
    fence = Fence()
    assert [fence.admits("d", epoch, now) for epoch, now in ((9, 0.0), (1, 60.0), (9, 60.1), (1, 64.9), (1, 66.0))] == [
        *(True, False, True, False, False)
    ]


def test_devices_are_bounded() -> None:
    fence = Fence(devices=2)
    for device in "abc":
        fence.admits(device, 9, 0.0)
    assert fence.admits("a", 1, 0.0)
    assert not fence.admits("c", 1, 0.0)


def test_from_the_first_number_of_a_turn_on_no_earlier_one_is_taken() -> None:
    turns = Turns()
    assert turns.of(1, 0, 10, 0.0) == 10
    assert turns.of(2, 30, 10, 0.1) == 10
    assert turns.of(1, 10, 10, 0.2) == 10  # it was under way for longer
    assert turns.of(1, 20, 15, 0.3) == 10
    assert turns.of(1, 35, 10, 0.4) == 0
    assert turns.of(2, 20, 10, 0.5) == 10
    assert turns.of(1, 20, 10, 0.6) == 0


def test_an_earlier_turn_is_not_taken_up_again_because_some_of_it_came_long_ago_and_comes_now() -> None:
    turns = Turns()
    assert [turns.of(epoch, 30, 10, now) for epoch, now in ((1, 0.0), (2, 1.0), (1, 2.0), (2, 60.0), (1, 61.0))] == [
        *(10, 10, 0, 10, 0)
    ]


def test_of_three_turns_the_first_is_over_where_the_second_begins() -> None:
    turns = Turns()
    for epoch, first in ((1, 0), (3, 50), (2, 20)):
        assert turns.of(epoch, first, 10, 0.0) == 10
    assert turns.of(1, 10, 20, 0.1) == 10
    assert turns.of(2, 40, 20, 0.1) == 10


def test_a_turn_is_forgotten_when_only_earlier_ones_come() -> None:
    turns = Turns()
    turns.of(9, 0, 10, 0.0)
    assert turns.of(1, 10, 10, 60.0) == 0, "it may have been held up as long as the line was"
    assert turns.of(1, 20, 10, 60.0 + FORGET_S) == 0
    assert turns.of(1, 30, 10, 60.1 + FORGET_S) == 10
    assert turns.of(1, 40, 10, 60.2 + FORGET_S) == 10


def test_a_subscriber_takes_a_sample_from_one_estimator_only_and_misses_none() -> None:
    """One hangs at sample 20; another goes on from 10 on; the first wakes up and says what it had begun."""
    once = Once()
    spans = [(0, 10, 1), (10, 20, 1), (10, 30, 2), (20, 25, 1), (30, 40, 2), (25, 45, 1), (40, 50, 2)]
    for at, (start, end, epoch) in enumerate(spans):
        once.feed(replace(batch(start, end - start), epoch=epoch), 0.01 * at)
    given = [event for event in once.ready if isinstance(event, CorrectedBatch)]
    assert [b.sequence + i for b in given for i in range(len(b))] == list(range(50))
    assert [b.epoch for b in given] == sorted(b.epoch for b in given)
    assert once.left_out.as_dict() == {"repeated": 10, "outdated": 25}
    assert once.missing == {}


def test_what_was_held_of_an_earlier_turn_is_not_given_after_a_later_one() -> None:
    once = Once(OnceKnobs(wait_s=1.0))
    came = [(0, 5, 1), (20, 30, 1), (8, 14, 1), (5, 10, 2), (10, 20, 2), (20, 25, 2), (25, 40, 2)]
    for at, (start, end, epoch) in enumerate(came):
        once.feed(replace(batch(start, end - start), epoch=epoch), 0.01 * at)
    assert [(b.sequence, len(b), b.epoch) for b in once.ready if isinstance(b, CorrectedBatch)] == [
        (0, 5, 1),
        (5, 5, 2),
        (10, 10, 2),
        (20, 5, 2),
        (25, 15, 2),
    ]
    assert once.left_out.as_dict() == {"repeated": 16}
    assert once.due() is None, "nothing is held"


def test_what_was_held_from_below_a_later_turn_is_given_before_it() -> None:
    once = Once(OnceKnobs(wait_s=1.0))
    came = [(0, 5, 1), (8, 14, 1), (12, 20, 2), (5, 8, 1)]
    for at, (start, end, epoch) in enumerate(came):
        once.feed(replace(batch(start, end - start), epoch=epoch), 0.01 * at)
    assert [(b.sequence, len(b), b.epoch) for b in once.ready if isinstance(b, CorrectedBatch)] == [
        (0, 5, 1),
        (5, 3, 1),
        (8, 4, 1),
        (12, 8, 2),
    ]


def test_what_was_held_of_an_earlier_turn_and_nobody_says_again_is_given_in_the_end() -> None:
    once = Once(OnceKnobs(wait_s=1.0))
    came = [(0, 5, 1), (20, 30, 1), (5, 20, 2), (30, 40, 3)]
    for at, (start, end, epoch) in enumerate(came):
        once.feed(replace(batch(start, end - start), epoch=epoch), 0.01 * at)
    assert [b.epoch for b in once.ready if isinstance(b, CorrectedBatch)] == [1, 2]
    due = once.due()
    assert due is not None
    once.overdue(due)
    given = [event for event in once.ready if isinstance(event, CorrectedBatch)]
    assert [(b.sequence, len(b), b.epoch) for b in given][2:] == [(20, 10, 1), (30, 10, 3)]
    assert (once.missing, once.due()) == ({}, None)


def _given(once: Once) -> list[tuple[int, int, int]]:
    """From, up to, and under which epoch; of those that follow each other without a hole together."""
    found = list[tuple[int, int, int]]()
    for event in once.ready:
        assert isinstance(event, CorrectedBatch)
        if found and found[-1][1:] == (event.sequence, event.epoch):
            found[-1] = found[-1][0], event.sequence + len(event), event.epoch
        else:
            found.append((event.sequence, event.sequence + len(event), event.epoch))
    return found


def test_what_only_a_former_estimator_says_is_given_in_the_end() -> None:
    """It has the device still, beyond a cut; who took it here is ended, and comes back when the cut is mended."""
    once = Once()
    for at, (start, end, epoch) in enumerate([(0, 10, 1), (10, 30, 2), (10, 20, 1), (20, 60, 1)]):
        once.feed(batch(start, end - start, epoch=epoch), 0.01 * at)
    assert _given(once) == [(0, 10, 1), (10, 30, 2)]
    once.feed(batch(60, 10, epoch=3), 0.1)
    once.overdue(0.3)
    assert _given(once) == [(0, 10, 1), (10, 30, 2), (30, 60, 1), (60, 70, 3)]
    assert once.left_out.as_dict() == {"outdated": 20}
    assert once.missing == {}


def test_who_had_it_beyond_a_cut_is_waited_for_by_who_would_wait_for_nobody_else() -> None:
    """The cut is mended as a third takes the device: its lines are there at once, what the second said in two seconds."""
    once = Once()
    once.feed(batch(0, 30, epoch=1), 0.0)
    once.feed(batch(60, 10, epoch=3), 6.0)
    once.overdue(8.0)
    assert _given(once) == [(0, 30, 1)]
    once.feed(batch(28, 20, epoch=2), 8.1)
    once.feed(batch(48, 20, epoch=2), 8.1)
    assert _given(once) == [(0, 30, 1), (30, 60, 2), (60, 70, 3)]
    assert not any(boot.held for boots in once._devices.values() for boot in boots.values())
    assert once.missing == {}


def test_what_nobody_else_can_have_is_not_waited_for_so_long() -> None:
    """A hole within a turn, and one that the device's or the bridge's is."""
    for lost in (batch(60, 10, epoch=1), batch(60, 10, epoch=3, flags=np.full(10, SampleFlag.AFTER_GAP, np.uint32))):
        once = Once()
        once.feed(batch(0, 30, epoch=1), 0.0)
        once.feed(lost, 6.0)
        once.overdue(6.1)
        assert once.missing["d"].samples == 30


def test_a_former_owner_that_has_nothing_to_say_is_given_up() -> None:
    once = Once()
    once.feed(batch(0, 30, epoch=1), 0.0)
    once.feed(batch(60, 10, epoch=3), 6.0)
    assert once.due() == 9.0
    once.overdue(9.0)
    assert once.missing["d"].samples == 30


def test_where_who_took_it_never_comes_back_nothing_is_lost_either() -> None:
    once = Once(OnceKnobs.patient(40.0))
    for at, (start, end, epoch) in enumerate([(0, 10, 1), (10, 30, 2), (20, 40, 1)]):
        once.feed(batch(start, end - start, epoch=epoch), 0.01 * at)
    for at in range(40, 180, 10):
        once.feed(batch(at, 10, epoch=1), at / 10)
    assert _given(once) == [(0, 10, 1), (10, 30, 2), (30, 180, 1)]
    assert once.due() is None


def test_the_end_of_a_boot_that_only_a_former_estimator_says_is_given_after_a_while_too() -> None:
    once = Once()
    for start, end, epoch in ((0, 30, 2), (20, 60, 1)):
        once.feed(batch(start, end - start, epoch=epoch), 0.0)
    assert (once.due(), _given(once)) == (FORGET_S, [(0, 30, 2)])
    once.overdue(FORGET_S)
    assert (once.due(), _given(once)) == (None, [(0, 30, 2), (30, 60, 1)])
    assert once.left_out.as_dict() == {"outdated": 10}


def test_of_two_former_ones_the_later_is_believed() -> None:
    once = Once()
    for start, epoch, now in ((0, 3, 0.0), (10, 1, 0.1), (10, 2, 0.2), (20, 1, 5.3)):
        once.feed(batch(start, 10, epoch=epoch), now)
    once.overdue(10.0)
    once.overdue(20.0)
    assert _given(once) == [(0, 10, 3), (10, 20, 2), (20, 30, 1)]


def test_whatever_comes_of_four_turns_none_is_given_twice_and_all_is_accounted_for() -> None:
    for seed in range(200):
        chance, now, came = random.Random(seed), 0.0, 0
        once, at = (
            Once(OnceKnobs(chance.choice((0.1, 7.0)), chance.choice((5, 60)))),
            [chance.randint(0, 60) for _ in range(4)],
        )
        for _ in range(120):
            now += chance.choice((0.0, 0.01, 0.1, 1.0, 6.0))
            due = once.due()
            if due is not None and due <= now:
                once.overdue(now)
                assert (once.due() or now) >= now
            epoch, n = chance.randrange(4), chance.randint(1, 12)
            once.feed(batch(at[epoch], n, epoch=epoch), now)
            at[epoch], came = max(0, at[epoch] + chance.choice((n, n, n, n - 20, n + 20))), came + n
        once.rest()
        assert once.due() is None
        given = [event for event in once.ready if isinstance(event, CorrectedBatch)]
        assert all(a.sequence + len(a) <= b.sequence for a, b in pairwise(given))
        assert sum(map(len, given)) + sum(once.left_out.as_dict().values()) == came


def test_at_the_end_it_is_given_too_and_of_too_much_the_oldest_goes() -> None:
    once = Once(OnceKnobs(window=20))
    for start, epoch in ((0, 2), *((start, 1) for start in range(10, 60, 10))):
        once.feed(batch(start, 10, epoch=epoch), 0.0)
    assert once.left_out.as_dict() == {"outdated": 10}
    once.rest()
    assert [e.sequence for e in once.ready if isinstance(e, CorrectedBatch)] == [0, 20, 30, 40, 50]
    assert once.missing["d"].samples == 10


def test_who_is_patient_waits_longer_for_who_has_a_device_to_hear_of_it_again() -> None:
    """Six seconds, and then it is another's: what the former one says meanwhile that one says again."""
    once = Once(OnceKnobs.patient(40.0))
    once.feed(batch(0, 5, epoch=2), 0.0)
    for at in range(1, 9):
        once.feed(batch(5 * at, 5, epoch=1), float(at))
    once.feed(batch(5, 40, epoch=3), 9.0)
    assert [(b.sequence, len(b), b.epoch) for b in once.ready if isinstance(b, CorrectedBatch)] == [
        (0, 5, 2),
        (5, 40, 3),
    ]
    assert once.left_out.as_dict() == {"outdated": 40}


def test_turns_that_overlap_come_out_once_in_order_and_whole() -> None:
    """Some estimators after each other, each for a while beside the next; what each says comes in order, theirs anyhow."""
    for seed in range(200):
        chance = random.Random(seed)
        turns, begins = [list[CorrectedBatch]() for _ in range(chance.randint(1, 4))], 0
        for epoch, turn in enumerate(turns, 1):
            ends = 400 if epoch == len(turns) else min(400, begins + chance.randint(20, 300))
            at = begins
            while at < ends:
                n = min(ends - at, chance.randint(1, 15))
                turn.append(batch(at, n, epoch=epoch))
                at += n
            begins = max(0, ends - chance.randint(0, 120))
        once, now = Once(OnceKnobs.patient(40.0)), 0.0
        while left := [turn for turn in turns if turn]:
            now += chance.choice((0.001, 0.01, 0.05))
            once.feed(chance.choice(left).pop(0), now)
        once.overdue(now + 40.0)
        given = [event for event in once.ready if isinstance(event, CorrectedBatch)]
        assert [b.sequence + i for b in given for i in range(len(b))] == list(range(400)), seed
        assert all(before.epoch <= after.epoch for before, after in pairwise(given)), seed
