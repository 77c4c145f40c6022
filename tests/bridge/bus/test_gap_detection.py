"""Messages that a network loses, repeats or reorders are handed on once and in order, while a publisher's cache has them."""

import random
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.bus import gap_detection as module
from bridge.bus.gap_detection import GapDetector
from bridge.bus.publisher_cache import Source

A = Source("t/a", b"a")


def live(sequences: GapDetector[int], *numbers: int, now_s: float = 0.0) -> list[int]:
    return [m for n in numbers for m in sequences.take(A, n, n, now_s)]


def test_invented_publishers_take_no_room_from_one_that_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_SOURCES", 100)
    monkeypatch.setattr(module, "MOST_HELD", 1000)
    sequences: GapDetector[int] = GapDetector()
    assert live(sequences, 0) == [0]
    for n in range(1000):
        sequences.take(Source(f"t/{n}", b"b"), 5, n, 1.0)
        if n % 10 == 0:
            assert live(sequences, 1 + n // 10) == [1 + n // 10]
    assert len(list(sequences.due(1.0, 10_000))) < 100


class Network:
    """Two publishers with a cache, and what reaches a subscriber of them."""

    def __init__(self, chance: random.Random, loss: float, cache: int) -> None:
        self._chance, self._loss, self._cache = chance, loss, cache
        self.sequences: GapDetector[tuple[str, int]] = GapDetector()
        self.sent = {"a": 0, "b": 0}
        self.got: dict[str, list[int]] = {"a": [], "b": []}

    def put(self, key: str, now_s: float) -> None:
        number = self.sent[key]
        self.sent[key] += 1
        if self._chance.random() >= self._loss:
            for _ in range(self._chance.choice([1, 1, 2])):
                self._hand_on(self.sequences.take(Source(key, b""), number, (key, number), now_s))

    def tell_last(self, now_s: float) -> None:
        for key, count in self.sent.items():
            if count:
                self.sequences.heard(Source(key, b""), count - 1, now_s)

    def answer(self, now_s: float, reached: float = 1.0) -> bool:
        gaps = self.sequences.due(now_s)
        for (key, identity), start in gaps:
            kept = range(max(start, self.sent[key] - self._cache), self.sent[key])
            found = {n: (key, n) for n in kept} if self._chance.random() < reached else {}
            self._hand_on(self.sequences.answered(Source(key, identity), found, now_s))
        return bool(gaps)

    def _hand_on(self, found: Iterable[tuple[str, int]]) -> None:
        for key, number in found:
            self.got[key].append(number)


@given(st.integers(0, 2**32), st.sampled_from([0.0, 0.1, 0.5, 0.9]), st.integers(1, 60))
def test_over_any_network_cached_messages_come_once_and_in_order(seed: int, loss: float, cache: int) -> None:
    chance = random.Random(seed)
    network = Network(chance, loss, cache)
    for turn in range(200):
        now_s = 0.05 * turn
        network.put(chance.choice("ab"), now_s)
        if turn % 7 == 0:
            network.tell_last(now_s)
        if chance.random() < 0.7:
            network.answer(now_s, reached=0.8)
    network.tell_last(20.0)
    while network.answer(20.0):
        pass
    for key, numbers in network.got.items():
        count = network.sent[key]
        assert numbers == sorted(set(numbers))
        assert numbers[-1:] == [count - 1][:count]
        assert len(numbers) + network.sequences.missed[key] + (numbers[0] if numbers else 0) == count
