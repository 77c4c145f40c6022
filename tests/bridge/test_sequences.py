"""What a network loses, doubles and turns round, and a publisher still has, is handed on in order and once."""

import random
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.bus.sequences import (
    GRACE_S,
    LAST_S,
    MOST_EARLY,
    MOST_HELD,
    MOST_SOURCES,
    MOST_TOLD,
    TRIES_S,
    WRAP,
    Sequences,
)

A, KEY = "publisher-a", "t/a"


def by_number(*numbers: int) -> dict[int, int]:
    return {n: n for n in numbers}


def live(sequences: Sequences[int], *numbers: int, now_s: float = 0.0) -> list[int]:
    return [m for n in numbers for m in sequences.take(A, KEY, n, n, now_s)]


def asked(sequences: Sequences[int], now_s: float = 0.0) -> list[int]:
    return [gap.start for gap in sequences.due(now_s)]


def given_up(sequences: Sequences[int], now_s: float = 0.0) -> list[int]:
    """Nobody answers, however often it is asked."""
    found: list[int] = []
    for tries in range(len(TRIES_S)):
        due_s = sequences.next_due_s()
        assert due_s is not None
        assert due_s >= now_s
        now_s = due_s
        assert asked(sequences, now_s), f"try {tries}"
        found += sequences.answered(A, {}, now_s)
    return found


def test_what_comes_in_order_is_handed_on_at_once() -> None:
    sequences: Sequences[int] = Sequences()
    assert live(sequences, 0, 1, 1, 2, 0) == [0, 1, 2]
    assert sequences.next_due_s() is None


def test_a_gap_is_asked_about_once_and_filled() -> None:
    sequences: Sequences[int] = Sequences()
    assert live(sequences, 0, 3, 4) == [0]
    assert asked(sequences) == [1]
    assert asked(sequences) == [], "it has been asked"
    assert live(sequences, 5) == []
    assert list(sequences.answered(A, by_number(1, 2, 3, 4), 0.1)) == [1, 2, 3, 4, 5]
    assert live(sequences, 4, 6) == [6]
    assert (sequences.next_due_s(), sequences.missed) == (None, {})


def test_what_a_cache_has_no_more_is_missed() -> None:
    sequences: Sequences[int] = Sequences()
    live(sequences, 0, 9)
    assert asked(sequences) == [1]
    assert list(sequences.answered(A, by_number(5, 7, 8, 9), 0.1)) == [5, 7, 8, 9]
    assert sequences.missed == {KEY: 5}


def test_of_whom_one_hears_first_the_past_comes_before_and_none_of_it_is_missed() -> None:
    sequences: Sequences[int] = Sequences()
    assert live(sequences, 40) == []
    assert asked(sequences) == [0]
    assert list(sequences.answered(A, by_number(31, 32, 39, 40), 0.1)) == [31, 32, 39, 40]
    assert sequences.missed == {KEY: 6}, "between two that came"


def test_history_and_what_came_meanwhile_overlap() -> None:
    sequences: Sequences[int] = Sequences()
    assert list(sequences.history(A, KEY, by_number(7, 8, 9), 0.0)) == [7, 8, 9]
    assert live(sequences, 8, 9, 10) == [10]
    assert sequences.missed == {}


def test_what_was_said_to_be_last_while_history_was_under_way_is_not_asked_for_if_it_came() -> None:
    sequences: Sequences[int] = Sequences()
    sequences.heard(A, KEY, 9, 0.0)
    assert list(sequences.history(A, KEY, by_number(7, 8, 9), 1.0)) == [7, 8, 9]
    assert asked(sequences, 9.0) == []
    sequences.heard(A, KEY, 10, 9.0)
    assert asked(sequences, 9.0 + GRACE_S) == [10]


def test_what_was_said_to_be_last_and_is_not_in_the_history_may_be_the_next_to_be_read() -> None:
    sequences: Sequences[int] = Sequences()
    sequences.heard(A, KEY, 11, 0.0)
    assert list(sequences.history(A, KEY, by_number(8, 9), 1.0)) == [8, 9]
    assert asked(sequences, 0.9) == []
    assert live(sequences, 10, 11) == [10, 11]
    assert asked(sequences, 9.0) == []


def test_nobody_answering_is_asked_again_and_given_up() -> None:
    sequences: Sequences[int] = Sequences()
    live(sequences, 0, 5)
    assert given_up(sequences) == [5]
    assert sequences.missed == {KEY: 4}
    assert live(sequences, 6) == [6]


def test_what_came_meanwhile_waits_no_longer_where_each_question_takes_long() -> None:
    sequences: Sequences[int] = Sequences()
    live(sequences, 0, 5, now_s=100.0)
    now_s, found = 100.0, list[int]()
    while not found:
        now_s = max(sequences.next_due_s() or 0.0, now_s)
        assert asked(sequences, now_s) == [1]
        now_s += 2.0
        found += sequences.answered(A, {}, now_s)
    assert found == [5]
    assert LAST_S <= now_s - 100.0 <= LAST_S + max(TRIES_S) + 2.0
    live(sequences, 7, now_s=200.0)
    assert asked(sequences, 200.0) == [6]
    assert sequences.answered(A, {}, 202.0) == [], "another gap has its own time"


def test_that_nobody_answers_is_said_once_long_before_it_is_given_up() -> None:
    sequences: Sequences[int] = Sequences()
    live(sequences, 0, 5, now_s=100.0)
    said_s, due_s = list[float](), sequences.next_due_s()
    while due_s is not None:
        assert asked(sequences, due_s) == [1]
        sequences.answered(A, {}, due_s)
        said_s += [due_s - 100.0 for _ in sequences.in_vain]
        sequences.in_vain.clear()
        due_s = sequences.next_due_s()
    assert len(said_s) == 1
    assert 3.0 < said_s[0] < LAST_S / 3


def test_who_was_out_of_reach_for_long_is_asked_again_soon() -> None:
    assert sum(TRIES_S) > 30.0, "as long as a bridge keeps what it has sent"
    assert max(TRIES_S) <= 4.0, "what came meanwhile waits for it"


def test_a_heartbeat_tells_of_what_never_came() -> None:
    sequences: Sequences[int] = Sequences()
    live(sequences, 0)
    sequences.heard(A, KEY, 0, 1.0)
    assert sequences.next_due_s() is None
    sequences.heard(A, KEY, 2, 1.0)
    assert asked(sequences, 1.0) == [], "it may have overtaken them"
    assert asked(sequences, 1.0 + GRACE_S) == [1]
    assert list(sequences.answered(A, by_number(1, 2), 1.1)) == [1, 2]


def test_a_heartbeat_that_overtook_is_of_no_account() -> None:
    sequences: Sequences[int] = Sequences()
    live(sequences, 0)
    sequences.heard(A, KEY, 1, 1.0)
    assert live(sequences, 1, now_s=1.0) == [1]
    assert sequences.next_due_s() is None


def test_a_heartbeat_that_lies_harms_nothing() -> None:
    sequences: Sequences[int] = Sequences()
    live(sequences, 0)
    sequences.heard(A, KEY, WRAP // 2, 0.0)
    assert given_up(sequences) == []
    assert (sequences.next_due_s(), sequences.missed) == (None, {})
    assert live(sequences, 1) == [1]


def test_more_than_can_be_held_is_not() -> None:
    sequences: Sequences[int] = Sequences()
    live(sequences, 0)
    found = live(sequences, *range(2, MOST_HELD + 10))
    assert found == list(range(2, MOST_HELD + 10))
    assert sequences.missed == {KEY: 1}


def test_numbers_that_begin_anew_go_on() -> None:
    sequences: Sequences[int] = Sequences()
    assert list(sequences.history(A, KEY, by_number(WRAP - 3, WRAP - 2), 0.0)) == [WRAP - 3, WRAP - 2]
    assert live(sequences, 1) == []
    assert asked(sequences) == [WRAP - 1]
    assert list(sequences.answered(A, by_number(WRAP - 1, 0, 1), 0.1)) == [WRAP - 1, 0, 1]
    assert live(sequences, 2, WRAP - 1, 0, 3) == [2, 3]
    sequences.heard(A, KEY, 5, 1.0)
    assert asked(sequences, 1.0 + GRACE_S) == [4]
    assert list(sequences.answered(A, by_number(5), 1.1)) == [5]
    assert sequences.missed == {KEY: 1}


class Network:
    """Two publishers with a cache, and what reaches a subscriber of them; the first of each has number `begins`."""

    def __init__(self, chance: random.Random, loss: float, cache: int, begins: int) -> None:
        self._chance, self._loss, self._cache, self._begins = chance, loss, cache, begins
        self.sequences: Sequences[tuple[str, int]] = Sequences()
        self.sent = {"a": 0, "b": 0}
        self.got: dict[str, list[int]] = {"a": [], "b": []}

    def put(self, source: str, now_s: float) -> None:
        number = self.sent[source]
        self.sent[source] += 1
        if self._chance.random() >= self._loss:
            for _ in range(self._chance.choice([1, 1, 2])):
                self._hand_on(self.sequences.take(source, source, self._as_said(number), (source, number), now_s))

    def beat(self, now_s: float) -> None:
        for source, count in self.sent.items():
            if count:
                self.sequences.heard(source, source, self._as_said(count - 1), now_s)

    def answer(self, now_s: float, reached: float = 1.0) -> None:
        for gap in self.sequences.due(now_s):
            start = (gap.start - self._begins) % WRAP if gap.start else 0
            kept = range(max(start, self.sent[gap.source] - self._cache), self.sent[gap.source])
            found = {self._as_said(n): (gap.source, n) for n in kept} if self._chance.random() < reached else {}
            self._hand_on(self.sequences.answered(gap.source, found, now_s))

    def _as_said(self, number: int) -> int:
        return (self._begins + number) % WRAP

    def _hand_on(self, found: Iterable[tuple[str, int]]) -> None:
        for source, number in found:
            self.got[source].append(number)


@given(
    st.integers(0, 2**32),
    st.sampled_from([0.0, 0.1, 0.5, 0.9]),
    st.integers(1, 60),
    st.sampled_from([0, WRAP // 2 - 50, WRAP - 50]),
)
def test_over_any_network_what_is_cached_comes_once_and_in_order(
    seed: int, loss: float, cache: int, begins: int
) -> None:
    chance = random.Random(seed)
    network = Network(chance, loss, cache, begins)
    for turn in range(200):
        now_s = 0.05 * turn
        network.put(chance.choice("ab"), now_s)
        if turn % 7 == 0:
            network.beat(now_s)
        if chance.random() < 0.7:
            network.answer(now_s, reached=0.8)
    network.beat(10.0)
    while (due_s := network.sequences.next_due_s()) is not None:
        network.answer(due_s)
    for source, numbers in network.got.items():
        count = network.sent[source]
        assert numbers == sorted(set(numbers))
        assert numbers[-1:] == [count - 1][:count]
        assert len(numbers) + network.sequences.missed[source] + (numbers[0] if numbers else 0) == count


@pytest.mark.parametrize("gone", [True, False])
def test_an_answer_after_all_was_well_changes_nothing(gone: bool) -> None:
    sequences: Sequences[int] = Sequences()
    live(sequences, 0, 2)
    assert asked(sequences) == [1]
    assert live(sequences, 1) == [1, 2]
    assert list(sequences.answered(A, {} if gone else by_number(1, 2), 0.1)) == []
    assert live(sequences, 3) == [3]
    assert list(sequences.answered("a stranger", by_number(1), 0.1)) == []


def test_what_waits_longest_is_asked_about_first() -> None:
    sequences: Sequences[int] = Sequences()
    for n in range(200):
        sequences.heard(f"b{n}", f"t/{n}", 5, 1.0)
    sequences.heard(A, KEY, 5, 0.5)
    gaps = sequences.due(2.0)
    assert (len(gaps), gaps[0].source) == (64, A)
    assert len(sequences.due(2.0)) == 64, "others than those that have been asked"


def test_whoever_makes_up_publishers_takes_no_room_from_those_of_whom_something_came() -> None:
    sequences: Sequences[int] = Sequences()
    assert live(sequences, 0) == [0]
    sequences.heard(A, KEY, 1, 0.0)
    for n in range(MOST_TOLD + 100):
        sequences.heard(f"b{n}", f"t/{n}", 5, 1.0)
    assert len(sequences._sources) == MOST_TOLD + 1
    assert sequences.due(2.0)[0] == (A, KEY, 1)
    assert list(sequences.answered(A, by_number(1), 2.0)) == [1]


def test_nor_does_who_says_something_once_under_each_of_many_names() -> None:
    sequences: Sequences[int] = Sequences()
    assert live(sequences, 0) == [0]
    handed_on = 0
    for n in range(2 * MOST_SOURCES):
        handed_on += len(sequences.take(f"b{n}", f"t/{n}", 5, n, 1.0))
        if n % 1000 == 0:
            assert live(sequences, 1 + n // 1000) == [1 + n // 1000]
    assert handed_on == 2 * MOST_SOURCES - MOST_EARLY, "what is not waited for any more is handed on"
    assert len(sequences._lacking) == MOST_EARLY
    assert len(sequences._sources) <= MOST_SOURCES


def test_of_one_that_was_not_waited_for_any_more_a_later_loss_is_asked_about() -> None:
    sequences: Sequences[int] = Sequences()
    assert live(sequences, 5) == []
    for n in range(MOST_EARLY):
        sequences.take(f"b{n}", f"t/{n}", 5, n, 0.0)
    while sequences.due(0.0):
        pass
    assert live(sequences, 7, now_s=1.0) == []
    assert (A, KEY, 6) in sequences.due(1.0)
