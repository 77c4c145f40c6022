"""Each sample once and in order, whatever comes: by hand, and for permutations of streams with holes and repeats."""

import time
from dataclasses import replace

import numpy as np
import pytest

from bridge.wire.messages import CorrectedBatch, SampleFlag
from estimator.once import Miss, Once, OnceKnobs
from tests.conftest import Effort
from tests.estimator.shuffled import LONGEST, delivered, expected, given, make_boot
from tests.estimator.test_revision import batch

KNOBS = OnceKnobs(wait_s=1.0, window=100, devices=3, boots=2, holes=4)
MINUTE_NS = 60_000_000_000


def said(once: Once) -> list[tuple[str, int, int]]:
    """What is ready, taken: batches as (device, first, last), misses as (-, first, last)."""
    found = [
        ("-", event.first, event.first + event.count - 1)
        if isinstance(event, Miss)
        else (event.device, event.sequence, event.sequence + len(event) - 1)
        for event in once.ready
    ]
    once.ready.clear()
    return found


def fed(*spans: tuple[int, int], knobs: OnceKnobs = KNOBS) -> Once:
    once = Once(knobs)
    for at, (start, end) in enumerate(spans):
        once.feed(batch(start, end - start), float(at))
    return once


def test_in_order_nothing_is_held() -> None:
    once = fed((0, 5), (5, 9))
    assert said(once) == [("d", 0, 4), ("d", 5, 8)]
    assert once.due() is None


def test_what_comes_before_its_turn_waits_for_it() -> None:
    once = fed((0, 5), (9, 12), (7, 9))
    assert said(once) == [("d", 0, 4)]
    assert once.due() == 2.0
    once.feed(batch(5, 2), 1.5)
    assert said(once) == [("d", 5, 6), ("d", 7, 8), ("d", 9, 11)]
    assert once.due() is None
    assert once.missing == {}


def test_a_hole_is_given_up_in_time_and_told_before_what_follows_it() -> None:
    once = fed((0, 5), (9, 12))
    once.overdue(1.9)
    assert said(once) == [("d", 0, 4)]
    once.overdue(2.0)
    assert said(once) == [("-", 5, 8), ("d", 9, 11)]
    assert once.missing["d"].samples == 4
    assert list(once.missing["d"].latest) == [Miss("d", 7, 5, 4, told=False)]


def test_each_waits_from_when_it_came() -> None:
    once = fed((0, 5), (20, 25), (10, 15), (30, 35))
    said(once)
    once.overdue(2.0)  # what came at 1 goes, and what is before it
    assert said(once) == [("-", 5, 9), ("d", 10, 14), ("-", 15, 19), ("d", 20, 24)]
    assert once.due() == 4.0


def test_what_made_way_for_a_later_turn_is_waited_for_no_more() -> None:
    once = fed((0, 5))
    once.feed(batch(9, 3, epoch=1), 1.0)
    once.feed(batch(15, 3, epoch=1), 1.5)
    once.feed(batch(9, 3, epoch=2), 1.9)  # the same again, by who has the device now
    assert once.due() == 4.5
    once.overdue(2.0)
    assert said(once) == [("d", 0, 4)]
    once.overdue(4.5)
    assert said(once) == [("-", 5, 8), ("d", 9, 11), ("-", 12, 14), ("d", 15, 17)]


def test_the_sample_after_a_hole_may_tell_of_it() -> None:
    once = fed((0, 5))
    flags = np.array([SampleFlag.AFTER_GAP, 0, 0], np.uint32)
    once.feed(batch(9, 3, flags=flags), 0.0)
    once.rest()
    assert [event.told for event in once.ready if isinstance(event, Miss)] == [True]


def test_what_comes_after_it_was_given_up_is_late_and_what_comes_again_repeated() -> None:
    once = fed((0, 5), (9, 12))
    once.rest()
    said(once)
    once.feed(batch(3, 8), 2.0)  # 3, 4 again, 5 to 8 late, 9, 10 again
    assert said(once) == []
    assert once.left_out.as_dict() == {"repeated": 4, "late": 4}


def test_parts_of_a_batch_that_are_new_are_taken_from_it() -> None:
    once = fed((0, 2), (4, 6), (8, 10), (1, 12))
    assert said(once) == [("d", 0, 1), ("d", 2, 3), ("d", 4, 5), ("d", 6, 7), ("d", 8, 9), ("d", 10, 11)]
    assert once.left_out.as_dict() == {"repeated": 5}


def test_too_much_that_is_held_pushes_the_first_out() -> None:
    once = fed((0, 5), *[(start, start + 5) for start in range(10, 115, 5)])  # 105 samples held of 100
    assert said(once)[:3] == [("d", 0, 4), ("-", 5, 9), ("d", 10, 14)]
    assert once.due() is None


def test_who_waits_long_holds_what_comes_meanwhile() -> None:
    once = Once(OnceKnobs.patient(40.0))
    for n in [0, *range(2, 700)]:  # 20 samples every 50 ms
        once.feed(batch(20 * n, 20), 0.05 * n)
    assert said(once) == [("d", 0, 19)]
    once.overdue(40.1)
    assert said(once)[:2] == [("-", 20, 39), ("d", 40, 59)]


def test_whoever_joins_late_waits_at_the_beginning_only_and_misses_nothing() -> None:
    once = fed((100, 105), (95, 100))
    assert said(once) == []
    once.overdue(1.0)
    assert said(once) == [("d", 95, 99), ("d", 100, 104)]
    assert once.missing == {}
    once.feed(batch(90, 5), 1.0)
    assert said(once) == []
    assert once.left_out.as_dict() == {"late": 5}


def test_a_device_started_anew_under_its_boot_number_begins_again() -> None:
    once = fed((0, 5), (9, 12))
    again = batch(0, 5)
    once.feed(replace(again, start_time_ns=batch(12).start_time_ns + MINUTE_NS), 1.0)
    assert said(once) == [("d", 0, 4), ("-", 5, 8), ("d", 9, 11), ("d", 0, 4)]


def _of_a_hole(epoch: int, later_ns: int) -> Once:
    """Given 0 to 4 and, after a hole, 60 to 64 under epoch 1, then 22 to 26: at a time after that."""
    once = Once(KNOBS)
    for first in (0, 60):
        once.feed(batch(first, 5, epoch=1), 0.0)
    once.overdue(2.0)
    assert said(once) == [("d", 0, 4), ("-", 5, 59), ("d", 60, 64)]
    for first in (22, 27):
        at_ns = batch(first + 42).start_time_ns + later_ns
        once.feed(batch(first, 5, epoch=epoch, start_time_ns=at_ns), 2.1)
    once.overdue(4.0)
    return once


def test_what_another_estimator_says_late_is_no_new_begin_though_the_bridge_mistook_its_time() -> None:
    """A bridge had been stopped as the device began: its first samples were taken for seconds later than they were."""
    for epoch, why in ((0, "outdated"), (2, "late")):
        once = _of_a_hole(epoch, 5_000_000_000)
        assert said(once) == []
        assert once.left_out.as_dict() == {why: 10}


@pytest.mark.parametrize("epoch", [1, 2, 3])
def test_nor_what_is_still_waited_for_at_such_a_time(epoch: int) -> None:
    """An estimator that takes a device over says first what came last of it."""
    once = Once(KNOBS)
    once.feed(batch(0, 5, epoch=1), 0.0)
    once.feed(batch(60, 5, epoch=2), 0.1)
    for first in range(5, 60, 5):
        at_ns = batch(first + 60).start_time_ns + 5_000_000_000
        once.feed(batch(first, 5, epoch=epoch, start_time_ns=at_ns), 0.2)
    once.overdue(5.0)
    firsts = [first for _, first, _ in said(once)]
    assert firsts == sorted(firsts)
    assert firsts[-1] == 60


def test_who_joined_in_the_middle_loses_nothing_of_a_device_that_was_started_anew() -> None:
    once = Once(KNOBS)
    once.feed(batch(3000, 5, epoch=1), 0.0)
    once.overdue(2.0)
    assert said(once) == [("d", 3000, 3004)]
    at_ns = batch(3007).start_time_ns + 2_000_000_000
    once.feed(batch(0, 5, epoch=2, start_time_ns=at_ns), 2.5)
    assert said(once) == [("d", 0, 4)]


def test_nor_for_longer_than_a_bridge_may_be_mistaken_nor_by_the_same_estimator() -> None:
    assert said(_of_a_hole(2, MINUTE_NS)) == [("d", 22, 26), ("d", 27, 31)]
    assert said(_of_a_hole(1, 5_000_000_000)) == [("d", 22, 26), ("d", 27, 31)]


def test_a_part_of_a_batch_of_a_slow_device_that_comes_again_is_no_new_begin() -> None:
    once = fed((0, 5), (5, 35), (30, 35))  # ten samples a second
    assert said(once) == [("d", 0, 4), ("d", 5, 34)]
    assert once.left_out.as_dict() == {"repeated": 5}


def test_of_too_many_boots_and_devices_the_oldest_are_forgotten() -> None:
    once = Once(KNOBS)

    def feed(device: str, boot: int) -> None:
        later = batch(0, 5).start_time_ns + boot * MINUTE_NS
        once.feed(batch(0, 5, device=device, boot=boot, start_time_ns=later), 0.0)

    for boot in (1, 2, 3, 3, 2, 1):
        feed("a", boot)
    assert once.left_out.as_dict() == {"repeated": 10}, "of boot 1 nothing is known any more"
    for device in ("b", "c", "d", "a"):
        feed(device, 3)
    assert once.left_out.as_dict() == {"repeated": 10}, "nor of device a"
    assert len(once._devices) == 3


def test_what_a_forgotten_boot_held_is_given() -> None:
    once = fed((0, 5), (9, 12))
    for boot in (8, 9):
        once.feed(batch(0, 5, boot=boot, start_time_ns=batch(0).start_time_ns + boot * MINUTE_NS), 5.0)
    assert ("d", 9, 11) in said(once)
    assert once.due() is None


def test_a_boot_that_begins_after_the_clock_was_set_back_is_not_the_one_that_is_forgotten() -> None:
    once = Once(KNOBS)
    for boot in (1, 2):
        once.feed(batch(0, 5, boot=boot), float(boot))
    said(once)
    for n in range(10):
        first = batch(5 * n, 5, boot=9)
        once.feed(replace(first, start_time_ns=first.start_time_ns - MINUTE_NS), 3.0)
    assert said(once) == [("d", 5 * n, 5 * n + 4) for n in range(10)]


def test_memory_is_bounded_whatever_comes() -> None:
    rng, once = np.random.default_rng(2), Once(KNOBS)
    for number in rng.integers(0, 2**40, 3000).tolist():
        once.feed(batch(number, 5, device=f"d{number % 7}", boot=number % 11), 0.0)
    boots = [boot for boots in once._devices.values() for boot in boots.values()]
    assert len(boots) <= KNOBS.devices * KNOBS.boots
    assert all(boot.samples <= KNOBS.window and len(boot.holes) <= KNOBS.holes for boot in boots)
    assert set(once.missing) <= set(once._devices)
    for number in range(0, 3000, 10):
        once.feed(batch(number, 5, device=f"lossy-{number // 10 % 9}"), float(number))
        once.overdue(number + KNOBS.wait_s)
    assert once.missing == {}, "of a device that is forgotten nothing is missing"
    for number in range(3000, 6000, 10):
        once.feed(batch(number, 5, device="lossy"), float(number))
        once.overdue(number + KNOBS.wait_s)
    assert [(device, len(one.latest)) for device, one in once.missing.items()] == [("lossy", KNOBS.holes)]
    assert once.missing["lossy"].samples == 5 * 299


@pytest.mark.soak
@pytest.mark.timeout(3600)
def test_permutations_come_out_as_the_sorted_stream_to_the_bit(effort: Effort) -> None:
    rng = np.random.default_rng(effort.seed)
    window = 64 + LONGEST
    begun, permutations = time.perf_counter(), effort(500, 100_000)
    for _ in range(permutations // 10):
        boots = [
            make_boot(rng, device, number, int(rng.integers(20, 120)), int(rng.integers(0, 2)) * 1000)
            for device, number in (("a", 1), ("a", 2), ("b", 1))
        ]
        want, holes = expected(boots), sum(int((~boot.there).sum()) for boot in boots)
        for displaced in rng.integers(0, 65, 10):
            batches, once = delivered(rng, boots, int(displaced)), Once(OnceKnobs(window=window))
            for one in batches:
                once.feed(one, 0.0)
            once.rest()
            events = list(once.ready)
            assert given(events) == want
            taken = sum(len(event) for event in events if isinstance(event, CorrectedBatch))
            assert sum(len(one) for one in batches) == taken + once.left_out.total()
            assert once.left_out.as_dict().keys() <= {"repeated"}
            assert sum(event.count for event in events if isinstance(event, Miss)) == holes
    if effort.long:
        print(f"{permutations} permutations in {time.perf_counter() - begun:.0f} s")  # noqa: T201
