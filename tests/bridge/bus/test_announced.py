"""That a session keeps what it said is announced anew, at no cost for who asks (zenoh alone)."""

import time

import pytest
import zenoh

from bridge.bus import announced, zenoh_bus
from bridge.bus.zenoh_bus import ZenohBus
from bridge.bus.zenoh_subscription import PAST_S
from tests.bridge.bus.worlds import ZenohWorld, eventually


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What was announced, each time that a question came to it."""
    found: list[str] = []

    def noted(query: zenoh.Query, answer: object = announced._nothing) -> None:
        found.append(str(query.key_expr))
        assert callable(answer)
        answer(query)

    monkeypatch.setattr(announced, "_nothing", noted)
    return found


def test_who_asks_one_cache_or_all_comes_by_an_announcement(asked: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """So does a router that has lost the caches themselves."""
    monkeypatch.setattr(zenoh_bus, "_ANNOUNCE_S", 0.3)
    world = ZenohWorld()
    with world.bus() as a, world.bus() as b:
        assert isinstance(a, ZenohBus)
        assert isinstance(b, ZenohBus)
        publisher = a.publisher("t/kept/d1", cache=64)
        publisher.put(b"0")
        session = a._session.zid()
        for question in ("t/kept/*/@adv/**", f"t/kept/d1/@adv/pub/{session}/1/**"):
            asked.clear()
            eventually(lambda q=question: _ask(b, q) >= 0 and q in asked)  # type: ignore[misc]
    world.stop()


def test_announcements_take_turns_and_are_all_taken_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zenoh_bus, "_ANNOUNCE_S", 1e9)
    world = ZenohWorld()
    with world.bus() as a:
        assert isinstance(a, ZenohBus)
        turns = announced.Announced(a, a._session)
        there = []
        for _ in range(7):
            turns.anew(["t/x/*"])
            there.append({str(queryable.key_expr).rpartition("/")[2] for queryable in turns._there["t/x/*"]})
        assert there[0] == {"again-0"}
        assert there[1:5] == [
            {"again-0", "again-1"},
            {"again-1", "again-2"},
            {"again-2", "again-0"},
            {"again-0", "again-1"},
        ]
        eventually(lambda: sum("again" in thread.name for thread in a._threads) == 2)
    assert a._threads == set()
    world.stop()


def test_nothing_of_the_past_is_lost_or_late_while_announcements_come_and_go(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zenoh_bus, "_ANNOUNCE_S", 0.0)
    monkeypatch.setattr(zenoh_bus, "_HEARTBEAT_S", 0.003)
    world = ZenohWorld()
    with world.bus() as a, world.bus() as b:
        assert isinstance(b, ZenohBus)
        publishers = [a.publisher(f"t/kept/d{n}", cache=64) for n in range(20)]
        for publisher in publishers:
            publisher.put(b"0")
        eventually(lambda: _ask(b, "t/kept/*/@adv/**") == 20)
        answers, took_s = [], []
        for _ in range(200):
            began_s = time.monotonic()
            answers.append(_ask(b, "t/kept/*/@adv/**"))
            took_s.append(time.monotonic() - began_s)
        assert answers == [20] * 200
        assert sorted(took_s)[100] < PAST_S / 2  # else they end by their timeout: who is announced says nothing
    world.stop()


def _ask(bus: ZenohBus, question: str) -> int:
    return sum(reply.ok is not None for reply in bus.past(question))
