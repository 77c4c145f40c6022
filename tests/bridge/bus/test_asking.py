"""Questions and answers."""

import threading
import time
from collections.abc import Callable

import pytest

from bridge.bus.contract import Bus, BusError, Reply
from tests.bridge.bus.worlds import World, eventually

PATIENCE_S = 60.0


def test_an_answer_comes_back(a: Bus, b: Bus) -> None:
    b.answer("q/*/double", lambda key, payload, reply: reply(key.encode() + payload * 2))
    eventually(lambda: answered(a, "q/x/double"))
    assert a.ask("q/x/double", b"ab", PATIENCE_S) == b"q/x/doubleabab"


def answered(bus: Bus, key: str) -> bool:
    try:
        return bool(bus.ask(key, b"", 0.5))
    except BusError as error:
        return "answered with an error" in str(error)


def test_of_all_who_answer_the_one_who_has_something_to_say_is_heard(world: World, a: Bus, b: Bus) -> None:
    asked: list[str] = []

    def of(name: str, says: bytes) -> Callable[[str, bytes, Reply], None]:
        def handler(key: str, payload: bytes, reply: Reply) -> None:
            asked.append(name)
            reply(says + payload if says else b"")

        return handler

    c = world.bus()
    with c:
        held = [b.answer("t/*", of("first", b"")), c.answer("t/*", of("second", b"mine: "))]
        eventually(lambda: answered(a, "t/x") and {*asked} == {"first", "second"})
        assert a.ask("t/x", b"hello", PATIENCE_S) == b"mine: hello"
        held[1].close()
        with pytest.raises(BusError, match="empty answer"):
            a.ask("t/x", b"hello", PATIENCE_S)


def test_asking_nobody_fails_at_once(a: Bus) -> None:
    began = time.monotonic()
    with pytest.raises(BusError, match="no program answers 'q/none'"):
        a.ask("q/none", b"", 90.0)
    assert time.monotonic() - began < 60.0


def test_an_answer_too_late_or_empty_is_a_failure(a: Bus, b: Bus) -> None:
    slow = list[Reply]()
    b.answer("q/slow", lambda key, payload, reply: slow.append(reply))
    b.answer("q/empty", lambda key, payload, reply: reply(b""))
    eventually(lambda: answered(a, "q/empty"))
    with pytest.raises(BusError):
        a.ask("q/empty", b"")
    with pytest.raises(BusError):
        a.ask("q/slow", b"", 0.3)
    for reply in slow:
        reply(b"late")


def test_an_answer_may_be_given_later_and_by_another_thread(a: Bus, b: Bus) -> None:
    def later(_key: str, payload: bytes, reply: Reply) -> None:
        threading.Timer(0.1, reply, (payload * 2,)).start()

    b.answer("q/later", later)
    eventually(lambda: answered(a, "q/later"))
    assert a.ask("q/later", b"ab", PATIENCE_S) == b"abab"


def test_a_handler_that_raises_is_heard_of_on_both_sides(a: Bus, b: Bus, caplog: pytest.LogCaptureFixture) -> None:
    def handler(key: str, payload: bytes, reply: Reply) -> None:
        if payload != b"good":
            raise ValueError("out of turns")
        reply(b"fine")

    b.answer("q/bad", handler)
    eventually(lambda: answered(a, "q/bad"))
    with pytest.raises(BusError, match="ValueError: out of turns"):
        a.ask("q/bad", b"", PATIENCE_S)
    assert a.ask("q/bad", b"good", PATIENCE_S) == b"fine"
    assert "the handler of queries on q/bad failed" in caplog.text
