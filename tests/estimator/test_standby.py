"""What others' devices have sent last: kept until it is corrected, in bounded room."""

from dataclasses import replace

import pytest

from bridge.bus.contract import Message
from bridge.wire import codec
from estimator.service import standby
from estimator.service.standby import HELD_S, MOST, OVERLAP_S, Standby
from tests.bridge.codec.examples import plain

KEY = "truerate/@v1/w/raw/b1/d1"
LATER = OVERLAP_S + 0.1


def message(first: int, boot: int = 7, n: int = 10) -> Message:
    return Message(KEY, codec.encode_samples(plain(n, sequence=first, boot=boot)))


def firsts(messages: list[Message]) -> list[tuple[int, int]]:
    found = [codec.decode_samples(*one) for one in messages]
    return [(batch.boot, batch.sequence) for batch in found]


def held(*messages: Message, at: float = 0.0) -> Standby:
    made = Standby(devices=3)
    for one in messages:
        made.hold("d1", one, at)
    return made


def test_what_is_not_corrected_is_kept_in_the_order_in_which_it_came() -> None:
    kept = held(message(0), message(20), message(10))
    assert firsts(kept.take("d1")) == [(7, 0), (7, 20), (7, 10)]
    assert kept.take("d1") == []


def test_what_is_corrected_goes_but_for_the_last_moments() -> None:
    kept = held(message(0), message(10), message(20))
    kept.done("d1", 7, 20, LATER - 0.2)
    assert len(firsts(kept.take("d1"))) == 3
    kept = held(message(0), message(10), message(20))
    kept.done("d1", 7, 20, LATER)
    assert firsts(kept.take("d1")) == [(7, 20)]


def test_who_is_behind_and_comes_further_keeps_nothing_waiting() -> None:
    kept = held(*(message(10 * n) for n in range(5)))
    kept.done("d1", 7, 10, 4.0)
    kept.done("d1", 7, 10, 8.0)
    assert kept.waits_s("d1", 10.0) == 6.0
    kept.done("d1", 7, 20, 10.0)
    assert kept.waits_s("d1", 10.5) == 0.5


def test_of_what_a_bridge_kept_and_says_at_once_only_the_last_moments_are_not_done() -> None:
    """An estimator that was back corrected 15 s of all its devices again."""
    begun_ns = 1_700_000_000_000_000_000
    past = [
        Message(KEY, codec.encode_samples(replace(plain(10, sequence=10 * i), receive_time_ns=begun_ns + i * 10**8)))
        for i in range(50)
    ]
    kept = held(*past, at=20.0)
    kept.done("d1", 7, 480, 20.1)
    assert [first for _, first in firsts(kept.take("d1"))] == list(range(450, 500, 10))
    kept = held(*past, at=20.0)
    kept.done("d1", 7, 300, 20.1)
    assert [first for _, first in firsts(kept.take("d1"))] == list(range(300, 500, 10))


def test_what_was_corrected_under_an_epoch_that_is_over_is_not_corrected() -> None:
    kept = held(message(0), message(10), message(20))
    kept.done("d1", 7, 10, LATER, epoch=2)
    kept.done("d1", 7, 30, LATER, epoch=1)
    assert firsts(kept.take("d1")) == [(7, 10), (7, 20)]


def test_what_goes_over_to_another_has_the_time_at_which_it_came() -> None:
    to = held(message(0), at=0.0)
    assert firsts(held(message(10), at=LATER).move("d1", to, LATER)) == [(7, 10)]
    to.done("d1", 7, 20, LATER + OVERLAP_S - 0.1)
    assert firsts(to.take("d1")) == [(7, 10)]


def test_what_came_before_something_corrected_and_is_not_stays() -> None:
    kept = held(message(0), message(20), message(10))
    kept.done("d1", 7, 20, LATER)
    assert firsts(kept.take("d1")) == [(7, 20), (7, 10)]


def test_half_a_message_is_not_corrected() -> None:
    kept = held(message(0), message(10))
    kept.done("d1", 7, 15, LATER)
    assert firsts(kept.take("d1")) == [(7, 10)]


def test_a_boot_that_whose_device_it_is_has_not_come_to_is_kept_and_one_before_it_goes() -> None:
    kept = held(message(0, boot=6), message(0, boot=7), message(0, boot=8))
    kept.done("d1", 7, 10, LATER)
    assert firsts(kept.take("d1")) == [(8, 0)]
    kept = held(message(0, boot=8))
    kept.done("d1", 7, 10, LATER)
    assert firsts(kept.take("d1")) == [(8, 0)]


def test_what_nobody_understands_goes_with_what_comes_after_it() -> None:
    kept = held(message(0), Message(KEY, b"\xff\xff"), message(10), Message(KEY, b"\xff"))
    kept.done("d1", 7, 20, LATER)
    assert [one.payload for one in kept.take("d1")] == [b"\xff"]


def test_what_is_old_is_forgotten_and_who_sends_nothing() -> None:
    kept = held(message(0))
    kept.hold("d1", message(10), HELD_S + 1)
    kept.hold("d2", message(10), 0.0)
    kept.tidy(HELD_S + 1)
    assert list(kept) == ["d1"]
    assert firsts(kept.take("d1")) == [(7, 10)]


def test_who_has_sent_nothing_that_is_not_done_is_forgotten() -> None:
    kept = held(message(0), message(10))
    kept.done("d1", 7, 20, LATER)
    kept.tidy(LATER)
    assert list(kept) == []


def test_room_is_bounded_by_device_by_bytes_and_in_devices() -> None:
    kept = held(*(message(10 * n) for n in range(MOST + 5)))
    assert kept.dropped == 5
    for device in "abcd":
        kept.hold(device, message(0), 0.0)
    assert len(kept) == 3


def test_what_is_done_makes_room_before_anything_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    kept = held(*(message(10 * n) for n in range(MOST)))
    kept.done("d1", 7, 100, LATER)
    kept.hold("d1", message(10 * MOST), LATER)
    assert kept.dropped == 0
    assert len(kept.take("d1")) == MOST + 1 - 10
    monkeypatch.setattr(standby, "MOST_BYTES", 4 * len(message(20).payload))
    kept = held(message(0), message(10), message(20))
    kept.done("d1", 7, 20, LATER)
    for n in range(3):
        kept.hold("d2", message(10 * n), LATER)
    assert kept.dropped == 0
    assert [len(kept.take(device)) for device in ("d1", "d2")] == [1, 3]


def test_what_was_done_by_who_has_it_no_more_stays_done() -> None:
    kept = held(message(0), message(10), message(20))
    kept.done("d1", 7, 20, LATER, epoch=1)
    kept.done("d1", 0, 0, LATER, epoch=2)
    assert firsts(kept.take("d1")) == [(7, 20)]


def test_what_comes_after_it_was_said_to_be_done_does_not_shorten_how_long_that_is_kept() -> None:
    """Who hangs says nothing more, and what it had said last may not have left it."""
    begun_ns = 1_700_000_000_000_000_000
    kept = Standby(devices=3)
    for n in range(20):
        sent = replace(plain(10, sequence=10 * n), receive_time_ns=begun_ns + n * 10**8)
        kept.hold("d1", Message(KEY, codec.encode_samples(sent)), 0.1 * n)
        if n == 9:
            kept.done("d1", 7, 100, 0.95)
    assert [first for _, first in firsts(kept.take("d1"))] == list(range(50, 200, 10))


def test_of_too_many_bytes_those_of_who_sends_most_go(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(standby, "MOST_BYTES", 4 * len(message(20).payload))
    kept = held(message(0), message(10), message(20))
    kept.hold("d2", message(0), 0.0)
    kept.hold("d2", message(10), 0.0)
    assert firsts(kept.take("d1")) == [(7, 10), (7, 20)]
    assert len(kept.take("d2")) == 2
    assert kept.dropped == 1
