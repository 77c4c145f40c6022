"""Whose turn it is: order within a device, patience for the others, floods that are dropped and counted."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.bus.contract import Message
from estimator.service import turns as rules
from estimator.service.turns import Turns


class Desk:
    """Turns whose work takes time by a clock of its own: cost_s of each message by key."""

    def __init__(self, cost_s: dict[str, float] | None = None) -> None:
        self.now, self.done = 0.0, list[Message]()
        self.dropped: dict[str, int] = {}
        self._cost_s = cost_s or {}
        self.turns = Turns(self.take, self.drop, lambda: self.now, lambda: self.now)

    def take(self, messages: Sequence[Message]) -> None:
        self.done += messages
        self.now += sum(self._cost_s.get(message.key, 1e-5) for message in messages)

    def drop(self, key: str, n: int) -> None:
        self.dropped[key] = self.dropped.get(key, 0) + n

    def numbers(self, key: str) -> list[int]:
        return [int(message.payload) for message in self.done if message.key == key]

    def finish(self) -> None:
        while self.turns.waiting:
            self.turns.round(())
            self.now += 0.0 if self.turns.pressing else 0.1


def messages(key: str, begin: int, end: int) -> list[Message]:
    return [Message(key, b"%d" % number) for number in range(begin, end)]


def test_who_sends_little_never_waits() -> None:
    desk = Desk()
    sent = [*messages("a", 0, 5), *messages("b", 0, 5)]
    desk.turns.round(sent)
    assert desk.done == sent


def test_a_flood_waits_for_the_others_and_is_dropped_from_the_oldest_on() -> None:
    desk = Desk({"flood": 1e-4})
    longest = 0.0
    for number in range(100):
        began = desk.now
        desk.turns.round([*messages("flood", 400 * number, 400 * (number + 1)), *messages("calm", number, number + 1)])
        longest = max(longest, desk.now - began)
        assert desk.numbers("calm")[-1] == number, "in the round it came in"
    assert longest < rules.ASIDE_S + 2 * rules.SHARE * 1e-4 + 1e-4
    desk.finish()
    flood = desk.numbers("flood")
    assert flood == sorted(flood)
    assert len(flood) + desk.dropped["flood"] == 40_000
    assert flood[-1] == 39_999, "what is newest is kept"
    assert desk.dropped.keys() == {"flood"}


def test_where_all_have_something_waiting_more_of_it_is_done_at_a_time() -> None:
    desk = Desk(dict.fromkeys("abcd", 1e-4))
    desk.turns.round([message for key in "abcd" for message in messages(key, 0, 200)])
    rounds = 0
    while desk.turns.waiting:
        began, rounds = desk.now, rounds + 1
        desk.turns.round([message for key in "abcd" for message in messages(key, 199 + rounds, 200 + rounds)])
        assert desk.now - began < rules.ALONE_S + rules.SHARE * 1e-4
    assert rounds < 10
    assert [desk.numbers(key) for key in "abcd"] == [list(range(200 + rounds))] * 4


def test_after_a_restart_one_device_after_the_other_is_brought_up_to_now_and_who_takes_long_comes_last() -> None:
    desk, back = Desk(dict.fromkeys(["turned", *"abc"], 1e-4)), "abc"
    for key in ("turned", *back):
        desk.turns.behind(key, soon=key in back)
    desk.turns.round([message for n in range(200) for key in ("turned", *back) for message in messages(key, n, n + 1)])
    at = 200
    while desk.turns.waiting:
        began = desk.now
        desk.turns.round([message for key in "abc" for message in messages(key, at, at + 1)])
        at += 1
        assert desk.now - began < rules.ALONE_S + (rules.SHARE + 3) * 1e-4, "who is up to now waits no longer than this"
    assert at < 225
    assert [desk.numbers(key) for key in back] == [list(range(at))] * 3
    assert [message.key for message in desk.done[:4]] == ["turned", *back], (
        "of each it is known at once that it is there"
    )
    begun = [desk.done.index(Message(key, b"1")) for key in (*back, "turned")]
    done = [desk.done.index(Message(key, b"199")) for key in (*back, "turned")]
    assert sorted([*begun, *done]) == [at for pair in zip(begun, done, strict=True) for at in pair], "at a stretch"
    desk.turns.round(messages("a", at, at + 1))
    assert desk.done[-1] == Message("a", b"%d" % at), "and afterwards they are like others"


def test_however_much_of_the_past_waits_what_comes_now_is_taken_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rules, "FULL", 100)
    desk = Desk(dict.fromkeys("ab", 1e-3))
    for key in "ab":
        desk.turns.behind(key, soon=True)
    desk.turns.round([message for n in range(200) for key in "ab" for message in messages(key, n, n + 1)])
    assert desk.turns.waiting > 300
    assert not desk.turns.full
    assert desk.turns.withdraw("b") == messages("b", 1, 200)
    desk.finish()
    assert desk.numbers("a") == list(range(200))
    desk.turns.round(messages("a", 200, 500))
    assert desk.turns.full, "it is like any other then"


def test_what_waits_already_when_it_is_said_to_be_of_the_past_keeps_its_order() -> None:
    desk = Desk({"a": 1e-3})
    desk.turns.round(messages("a", 0, 200))
    desk.turns.behind("a", soon=True)
    desk.turns.round(messages("a", 200, 210))
    desk.finish()
    assert desk.numbers("a") == list(range(210))


def test_what_is_to_come_last_is_not_dropped_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rules, "MOST", 400)
    desk = Desk(dict.fromkeys(["turned", *"abc"], 1e-3))
    for key in ("turned", *"abc"):
        desk.turns.behind(key, soon=key != "turned")
    desk.turns.round([message for n in range(300) for key in ("turned", *"abc") for message in messages(key, n, n + 1)])
    at = 300
    while desk.turns.waiting:
        desk.turns.round(messages("turned", at, at + 2))
        at += 2
    assert desk.dropped == {}
    assert desk.numbers("turned") == list(range(at))


def test_where_rounds_take_long_what_waits_has_a_part_of_the_time() -> None:
    """An estimator that was back had its devices' last seconds set aside, and on a busy machine came to them seconds later."""
    desk = Desk({"calm": 1e-2, "back": 1e-3})
    desk.turns.round(messages("back", 0, 300))
    waits_since = desk.now
    while desk.turns.waiting:
        began = desk.now
        desk.turns.round(messages("calm", 0, 25))
        assert desk.now - began < 0.25 * (1 + rules.PART) + rules.SHARE * 1e-3, "the others still have most of it"
    assert desk.now - waits_since < 1.5, "2 ms in each would take 2.5 s"
    assert desk.numbers("back") == list(range(300))


def test_after_a_long_pause_what_waits_has_no_more_than_a_moment() -> None:
    desk = Desk({"back": 1e-3})
    desk.turns.round(messages("back", 0, 3000))
    desk.now += 60.0
    began = desk.now
    desk.turns.round(messages("calm", 0, 1))
    assert desk.now - began < rules.PART_S + rules.SHARE * 1e-3 + 1e-4


def test_a_flood_is_handled_no_faster_than_any_device_sends() -> None:
    desk = Desk()
    for millisecond in range(10_000):
        desk.turns.round(messages("flood", 10 * millisecond, 10 * millisecond + 10))
        desk.turns.round(messages("flood", 10**6 + 90 * millisecond, 10**6 + 90 * (millisecond + 1)))
        desk.now = max(desk.now, 1e-3 * millisecond)
    assert desk.turns.pressing is False
    handled = len(desk.numbers("flood"))
    assert rules.AT_ONCE < handled < rules.AT_ONCE + 11 * 2 * rules.A_SECOND + rules.SHARE
    assert handled + desk.dropped["flood"] + desk.turns.waiting == 10**6


def test_a_flood_in_small_rounds_is_held_to_the_same_share_and_soon_forgotten() -> None:
    desk = Desk({"flood": 1e-6, "calm": 1e-6})
    for millisecond in range(20_000):
        calm = messages("calm", millisecond, millisecond + 1) if millisecond % 50 == 0 else []
        desk.turns.round([*messages("flood", 10 * millisecond, 10 * millisecond + 10), *calm])
        desk.now = max(desk.now, 1e-3 * (millisecond + 1))
    assert len(desk.numbers("calm")) == 400
    assert len(desk.numbers("flood")) < rules.AT_ONCE + 21 * 2 * rules.A_SECOND + rules.SHARE
    desk.now += 60.0
    desk.finish()
    desk.turns.round(messages("flood", 10**6, 10**6 + 10))
    assert desk.numbers("flood")[-10:] == list(range(10**6, 10**6 + 10)), "it is not held against it"


def test_a_cache_of_the_fastest_bridge_is_taken_at_once() -> None:
    desk = Desk({"a": 1e-6})
    desk.turns.round(messages("a", 0, 2000))
    while desk.turns.pressing:
        desk.turns.round(())
    assert len(desk.numbers("a")) == 2000
    assert desk.now < 0.1


def test_fifty_long_calibrations_are_one_between_two_rounds() -> None:
    slow = [f"s{n:02d}" for n in range(50)]
    desk = Desk(dict.fromkeys(slow, 0.013))
    for key in slow:
        desk.turns.slow(key, now=True)
    desk.turns.round([message for key in slow for message in messages(key, 0, 2)])
    for number in range(100):
        began = desk.now
        desk.turns.round(messages("calm", number, number + 1))
        assert desk.now - began < 0.013 + 1e-4
    assert desk.turns.waiting == 0
    assert all(desk.numbers(key) == [0, 1] for key in slow)
    desk.turns.slow("s00", now=False)
    desk.turns.round(messages("s00", 2, 3))
    assert desk.numbers("s00") == [0, 1, 2]


@given(st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 60), st.booleans()), max_size=40))
def test_what_one_device_says_keeps_its_order_and_nothing_is_lost(rounds: list[tuple[str, int, bool]]) -> None:
    desk = Desk({"a": 1e-3})
    sent = dict.fromkeys("abc", 0)
    for key, n, slow in rounds:
        desk.turns.slow(key, now=slow)
        desk.turns.round(messages(key, sent[key], sent[key] + n))
        sent[key] += n
    desk.finish()
    assert {key: desk.numbers(key) for key in "abc"} == {key: list(range(n)) for key, n in sent.items()}
    assert desk.dropped == {}


def test_with_too_many_waiting_nothing_more_is_to_be_taken_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rules, "FULL", 100)
    desk = Desk({"a": 4e-3})
    desk.turns.round(messages("a", 0, 200))
    assert desk.turns.full
    desk.finish()
    assert not desk.turns.full


@pytest.mark.parametrize("keys", [6, 12])
def test_however_many_send_too_much_who_does_not_is_heard_at_once(keys: int) -> None:
    floods = [f"flood{n}" for n in range(keys)]
    desk = Desk()
    for number in range(500):
        desk.turns.round([message for key in floods for message in messages(key, 25 * number, 25 * number + 25)])
        assert not desk.turns.full
        desk.turns.round(messages("calm", number, number + 1))
        assert desk.numbers("calm") == list(range(number + 1))
        desk.now = max(desk.now, 0.01 * number)
    assert all(desk.dropped[key] > 0 for key in floods)
    assert desk.turns.waiting <= keys * (rules.A_SECOND + 25)


def test_what_is_large_counts_as_many_and_what_takes_long_is_handled_seldom() -> None:
    desk = Desk({"large": 1e-3, "long": 0.1})
    large = [Message("large", b"%04d" % n + bytes(20_000)) for n in range(8)]
    desk.turns.round(large)
    assert len(desk.done) < 8, "as many as 80"
    desk.done.clear()
    for number in range(2000):
        desk.turns.round([*messages("long", 2 * number, 2 * number + 2)])
        desk.turns.slow("long", now=True)
        desk.now = max(desk.now, 0.05 * number)
    spent = 0.1 * sum(message.key == "long" for message in desk.done)
    assert spent < 2.5 + 0.25 * desk.now


def test_a_large_one_drops_no_more_of_the_small_ones_before_it_than_it_takes_room_for() -> None:
    desk = Desk({"a": 1.0})
    desk.turns.round(messages("a", 0, 3000))
    desk.turns.round([Message("a", b"3000" + bytes(40_000))])
    assert desk.dropped == {}
    desk.turns.round(messages("a", 3001, 4200))
    assert 0 < desk.dropped["a"] < 4200 - rules.MOST + 40_004 // rules.LARGE + 2 * rules.SHARE


def test_who_is_brought_up_to_now_is_so_though_what_it_teaches_takes_long() -> None:
    desk = Desk({"back": 8e-3})
    desk.turns.behind("back", soon=False)
    desk.turns.slow("back", now=True)
    at = 600
    desk.turns.round(messages("back", 0, at))
    while desk.turns.of_the_past("back"):
        desk.turns.round(messages("back", at, at + 1))
        at, desk.now = at + 1, desk.now + 0.05
        assert desk.now < 60.0
    assert desk.dropped == {}
    desk.finish()
    assert desk.numbers("back") == list(range(at))


def test_a_flood_that_begins_as_a_past_is_bounded_and_is_none_any_more() -> None:
    desk = Desk({"flood": 1e-3})
    desk.turns.behind("flood", soon=False)
    large = [Message("flood", b"%08d" % n + bytes(60_000)) for n in range(2000)]
    for begin in range(0, 2000, 10):
        desk.turns.round(large[begin : begin + 10])
        desk.now += 0.01
    assert desk.dropped["flood"] > 0
    assert not desk.turns.of_the_past("flood")
    assert desk.turns.waiting * 60_000 < 4 * rules.MOST * rules.LARGE
    assert desk.turns.waiting + len(desk.done) + desk.dropped["flood"] == 2000
