"""Keys and patterns: what they mean to zenoh, and hostile ones."""

import pytest

from bridge.bus.contract import Bus, BusError
from bridge.bus.key_expressions import matches
from tests.bridge.bus.worlds import collect, meet
from tests.memory_bus import MemoryBroker, MemoryBus


def test_a_pattern_takes_its_own_keys_only(a: Bus, b: Bus) -> None:
    subscription = b.subscribe("t/*/x", history=True)
    meet(a.publisher("t/0/x"), subscription)
    for key in ("t/1/x", "t/@2/x", "t/1/y", "t/x", "t/1/2/x", "t/3/x"):
        a.publisher(key, cache=1).put(key.encode())
    assert sorted(collect(subscription, 2)) == [("t/1/x", b"t/1/x"), ("t/3/x", b"t/3/x")]


@pytest.mark.parametrize(
    ("pattern", "key", "expected"),
    [
        ("a/**", "a", True),
        ("a/**", "a/b/c", True),
        ("a/**", "a/@b", False),
        ("**", "@a", False),
        ("*", "@a", False),
        ("**/b", "a/@x/b", False),
        ("a/**/@b", "a/c/@b", True),
        ("a/@b/**", "a/@b", True),
        ("a/**/c", "a/c", True),
        ("a/*", "a", False),
        ("a/b", "a/b/c", False),
    ],
)
def test_patterns_mean_what_they_mean_to_zenoh(pattern: str, key: str, expected: bool) -> None:
    assert matches(pattern, key) is expected
    with MemoryBus(MemoryBroker()) as bus:
        subscription = bus.subscribe(pattern)
        bus.publisher(key).put(b"1")
        assert (subscription.receive(0) is not None) is expected


@pytest.mark.parametrize(
    "key", ["", "/a", "a/", "a//b", "a/*", "**", "a/$*", "a b", "a\n", "a\0", "a?b", "a#", "\ud800", "é"]
)
def test_a_hostile_key_is_refused_and_harms_nothing(a: Bus, key: str) -> None:
    for declare in (a.publisher, a.declare_alive, lambda k: a.ask(k, b"", 0.1)):
        with pytest.raises(BusError):
            declare(key)
    subscription = a.subscribe("t/ok")
    a.publisher("t/ok").put(b"1")
    assert subscription.receive(30.0) is not None


@pytest.mark.parametrize("pattern", ["", "a//b", "a*", "a/**/**", "a/**/*", "***", "$*", "a" * 401])
def test_a_hostile_pattern_is_refused(a: Bus, pattern: str) -> None:
    with pytest.raises(BusError):
        a.subscribe(pattern)
    with pytest.raises(BusError):
        a.watch_alive(pattern, lambda key, alive: None)
    with pytest.raises(BusError):
        a.answer(pattern, lambda key, payload, reply: reply(payload))


@pytest.mark.parametrize("length", [401, 70_000])
def test_a_key_too_long_leaves_the_bus_usable(a: Bus, b: Bus, length: int) -> None:
    publisher, subscription = a.publisher("t/before"), b.subscribe("t/before")
    with pytest.raises(BusError, match=f"{length} characters"):
        a.publisher("k" * length)
    meet(publisher, subscription)
