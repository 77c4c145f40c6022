"""Each sample once and in order, whatever comes: by hand, and for any mixture of estimators, losses and repeats."""

from itertools import pairwise
from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.wire.messages import CorrectedBatch
from estimator.client import Miss
from estimator.client.reorder_buffer import HANDOVER_S, WAIT_S, ReorderBuffer
from tests.estimator.client.test_revision import batch

MINUTE_NS = 60_000_000_000


def numbered(first: int, n: int, epoch: int = 0, **changes: object) -> CorrectedBatch:
    """A batch whose rates are the samples' numbers."""
    rate = np.repeat(np.arange(first, first + n, dtype=np.float32)[:, None], 3, axis=1)
    return batch(first, n, epoch=epoch, rate=rate, **changes)


def said(buffer: ReorderBuffer) -> list[tuple[int, int, int | None]]:
    """What is ready, taken: (first, end, epoch) of batches that follow each other, of one epoch; (first, end, None) of misses."""
    found = list[tuple[int, int, int | None]]()
    for event in buffer.ready:
        first, n, epoch = (
            (event.first, event.count, None) if isinstance(event, Miss) else (event.sequence, len(event), event.epoch)
        )
        if isinstance(event, CorrectedBatch):
            np.testing.assert_array_equal(event.rate[:, 0], np.arange(first, first + n))
        if found and found[-1][1:] == (first, epoch):
            found[-1] = found[-1][0], first + n, epoch
        else:
            found.append((first, first + n, epoch))
    buffer.ready.clear()
    return found


def fed(*spans: tuple[int, int], wait_s: float = WAIT_S, epoch: int = 0, now: float = 0.0) -> ReorderBuffer:
    buffer = ReorderBuffer(wait_s)
    for start, end in spans:
        buffer.feed(numbered(start, end - start, epoch), now)
    return buffer


def test_who_joins_does_not_listen_to_an_older_epoch_that_is_ahead() -> None:
    buffer = fed((900, 910), epoch=6)
    buffer.feed(numbered(1000, 10, 5), 0.01)
    buffer.overdue(WAIT_S + 0.02)
    for first in range(910, 1100, 10):
        buffer.feed(numbered(first, 10, 6), 0.2)
    assert said(buffer) == [(900, 1100, 6)]


def test_a_batch_before_its_turn_waits_for_the_samples_before_it() -> None:
    buffer = fed((0, 5), (9, 12), (7, 9))
    assert said(buffer) == [(0, 5, 0)]
    assert buffer.due() == WAIT_S
    buffer.feed(numbered(5, 2), 0.05)
    assert said(buffer) == [(5, 12, 0)]
    assert (buffer.due(), buffer.missing) == (inf, {})


def test_a_hole_is_given_up_in_time_and_told_before_the_batch_after_it() -> None:
    buffer = fed((0, 5), (9, 12), wait_s=1.0)
    buffer.overdue(0.9)
    assert said(buffer) == [(0, 5, 0)]
    buffer.overdue(1.0)
    assert buffer.ready[0] == Miss("d", 7, 5, 4, told=False)
    assert said(buffer) == [(5, 9, None), (9, 12, 0)]
    assert buffer.missing == {"d": 4}
    buffer.feed(numbered(3, 7), 2.0)  # all of it again, or too late
    assert (said(buffer), buffer.repeated) == ([], 7)


# ---- several estimators --------------------------------------------------------------------------------------------


def test_a_new_owner_publishes_everything_since_the_checkpoint_again() -> None:
    buffer = fed((0, 30), epoch=1)
    for first in range(10, 60, 10):
        buffer.feed(numbered(first, 10, epoch=2), 0.5)
    assert said(buffer) == [(0, 30, 1), (30, 60, 2)]
    assert (buffer.repeated, buffer.missing) == (20, {})


def test_an_estimator_that_hung_and_goes_on_is_not_listened_to() -> None:
    buffer = fed((0, 20), epoch=1)
    buffer.feed(numbered(10, 20, epoch=2), 1.0)
    for n in range(100):  # for ten seconds, and always before the owner
        buffer.feed(numbered(20 + 10 * n, 20, epoch=1), 2.0 + n / 10)
        buffer.overdue(2.05 + n / 10)
        buffer.feed(numbered(30 + 10 * n, 10, epoch=2), 2.05 + n / 10)
    assert said(buffer) == [(0, 20, 1), (20, 1030, 2)]
    assert buffer.missing == {}


def test_what_only_a_former_owner_says_is_given_after_a_while() -> None:
    """It has the device still, beyond a cut; the one that took it on this side was killed. Or its clock was set back."""
    buffer = fed((0, 10), epoch=1)
    buffer.feed(numbered(10, 20, epoch=2), 0.1)
    for n in range(60):
        now = 0.2 + n / 10
        buffer.feed(numbered(20 + 10 * n, 10, epoch=1), now)
        buffer.overdue(now)
        if now < HANDOVER_S:
            assert buffer.ready[-1].epoch == 2  # type: ignore[union-attr]
    assert said(buffer) == [(0, 10, 1), (10, 30, 2), (30, 620, 1)]
    assert (buffer.due(), buffer.missing) == (inf, {})


# ---- boots ---------------------------------------------------------------------------------------------------------


def later(first: int, by_ns: int, epoch: int = 0) -> CorrectedBatch:
    """A batch that begins so long after sample 70."""
    return numbered(first, 5, epoch, start_time_ns=batch(70).start_time_ns + by_ns)


def test_a_device_started_anew_under_its_boot_number_begins_again() -> None:
    buffer = fed((0, 60), (65, 70))
    for number in (0, 5):
        buffer.feed(later(number, 2_000_000_000), 1.0)
    assert said(buffer) == [(0, 60, 0), (60, 65, None), (65, 70, 0), (0, 10, 0)]


@pytest.mark.parametrize(("later_ns", "epoch"), [(500_000_000, 0), (20_000_000_000, 1), (-MINUTE_NS, 0)])
def test_low_numbers_are_repeats_where_they_are_not_later_or_another_estimators(later_ns: int, epoch: int) -> None:
    """A bridge that has just begun, or stood still, takes samples for later than they were."""
    buffer = fed((0, 70))
    buffer.feed(later(0, later_ns, epoch), 1.0)
    assert (said(buffer), buffer.repeated) == ([(0, 70, 0)], 5)
    buffer.feed(later(0, MINUTE_NS, epoch), 2.0)
    assert said(buffer) == [(0, 5, epoch)]


@pytest.mark.parametrize("epoch", [1, 3])
def test_samples_dated_by_a_wrong_clock_are_repeats_when_another_estimator_replays_them(epoch: int) -> None:
    """The bridge's clock was an hour ahead for a moment; the estimator before, or the next one, replays its last seconds."""
    buffer = fed((0, 70), epoch=2)
    buffer.feed(later(70, 60 * MINUTE_NS, epoch=2), 1.0)
    buffer.feed(numbered(75, 25, epoch=2), 1.1)
    buffer.feed(later(70, 60 * MINUTE_NS, epoch), 1.2)
    buffer.overdue(inf)
    assert (said(buffer), buffer.repeated) == ([(0, 100, 2)], 5)


# ---- any mixture ---------------------------------------------------------------------------------------------------

SPANS = st.lists(st.tuples(st.integers(0, 60), st.integers(1, 12), st.integers(0, 3), st.floats(0.0, 2.0)), max_size=40)


@given(SPANS, st.booleans())
def test_whatever_comes_nothing_is_given_twice_and_all_is_accounted_for(
    came: list[tuple[int, int, int, float]], in_time: bool
) -> None:
    """Numbers, epochs and delays at random. Where nobody is waited for in vain, all that came is given."""
    buffer, now, there = ReorderBuffer(), 0.0, set[int]()
    for first, n, epoch, passes_s in came:
        buffer.feed(numbered(first, n, epoch), now)
        there |= {*range(first, first + n)}
        now += 0.0 if in_time else passes_s
        buffer.overdue(now)
        assert buffer.due() > now
    buffer.overdue(inf)
    given = [event for event in buffer.ready if isinstance(event, CorrectedBatch)]
    numbers = [number for one in given for number in range(one.sequence, one.sequence + len(one))]
    assert numbers == sorted(set(numbers))
    if in_time:
        assert set(numbers) == there
    assert len(numbers) + buffer.repeated == sum(n for _, n, _, _ in came)
    assert sum(event.count for event in buffer.ready if isinstance(event, Miss)) == buffer.missing.get("d", 0)
    assert buffer.missing.get("d", 0) == sum(b.sequence - a.sequence - len(a) for a, b in pairwise(given))
    assert said(buffer) is not None
    assert buffer.due() == inf


@given(st.data())
def test_takeovers_come_out_whole_and_in_order_of_epochs(data: st.DataObject) -> None:
    """Estimators after each other, each from before where the former one had come to; the former may go on beside it.

    Each says its samples in order and in batches of its own, some of them twice; the lines to them are of different speeds.
    Nothing of an estimator is given that the next one has said before.
    """
    turns, begin, epochs = list[list[CorrectedBatch]](), 0, data.draw(st.integers(1, 4))
    for epoch in range(1, epochs + 1):
        end = 120 if epoch == epochs else data.draw(st.integers(begin, 120))
        at, turn = begin, list[CorrectedBatch]()
        goes_on = min(120, end + data.draw(st.integers(0, 30)))
        while at < goes_on:
            n = min(goes_on - at, data.draw(st.integers(1, 15)))
            turn += [numbered(at, n, epoch)] * data.draw(st.sampled_from((1, 1, 2)))
            at += n
        turns.append(turn)
        begin = max(0, end - data.draw(st.integers(0, 40)))
    buffer, now, said_by = ReorderBuffer(), 0.0, dict[int, int]()
    while left := [turn for turn in turns if turn]:
        now += data.draw(st.sampled_from((0.0, 0.001, 0.01)))
        one = data.draw(st.sampled_from(left)).pop(0)
        taken = len(buffer.ready)
        buffer.feed(one, now)
        said_by |= {n: max(one.epoch, said_by.get(n, 0)) for n in range(one.sequence, one.sequence + len(one))}
        for event in list(buffer.ready)[taken:]:
            assert isinstance(event, CorrectedBatch)
            assert all(event.epoch == said_by[n] for n in range(event.sequence, event.sequence + len(event)))
    buffer.overdue(inf)
    given = [event for event in buffer.ready if isinstance(event, CorrectedBatch)]
    assert [n for one in given for n in range(one.sequence, one.sequence + len(one))] == list(range(120))
    assert not buffer.missing
