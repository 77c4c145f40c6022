"""A closed bus says so, and harms nobody."""

import threading
import time

import pytest

from bridge.bus.contract import Bus, BusError, Declared
from tests.bridge.bus.worlds import World


def test_closing_twice_is_closing_once(world: World) -> None:
    bus = world.bus()
    declared: list[Declared] = [
        bus.publisher("t/c", cache=5),
        bus.subscribe("t/c", history=True),
        bus.subscribe("t/c"),
        bus.answer("q/c", lambda key, payload, reply: reply(payload)),
        bus.declare_alive("alive/c"),
        bus.watch_alive("alive/c", lambda key, alive: None),
    ]
    for one in declared:
        one.close()
        one.close()
    bus.close()
    bus.close()
    for one in declared:
        one.close()


def test_a_closed_bus_says_so(world: World) -> None:
    bus = world.bus()
    publisher, subscription = bus.publisher("t/x"), bus.subscribe("t/x")
    before = bus.connected
    bus.close()
    assert (before, bus.connected) == (True, False)
    assert subscription.receive(5.0) is None
    assert subscription.drain(5, 5.0) == []
    for use in (
        lambda: publisher.put(b""),
        lambda: bus.publisher("t/y"),
        lambda: bus.subscribe("t/y", history=True),
        lambda: bus.ask("t/y", b""),
        lambda: bus.answer("t/y", lambda key, payload, reply: reply(payload)),
        lambda: bus.declare_alive("t/y"),
        lambda: bus.watch_alive("t/y", lambda key, alive: None),
    ):
        with pytest.raises(BusError):
            use()


@pytest.mark.parametrize("history", [False, True])
def test_a_subscription_says_when_nothing_will_come_again(world: World, history: bool) -> None:
    with world.bus() as bus:
        own, of_the_bus = (bus.subscribe("t/end", history=history) for _ in range(2))
        assert (own.closed, of_the_bus.closed) == (False, False)
        assert own.receive(0) is None
        own.close()
        assert (own.closed, of_the_bus.closed) == (True, False)
    assert of_the_bus.closed


def test_a_reader_waiting_is_woken_by_close(a: Bus) -> None:
    subscription = a.subscribe("t/wait")
    threading.Timer(0.1, subscription.close).start()
    began = time.monotonic()
    assert subscription.receive(90.0) is None
    assert time.monotonic() - began < 60.0
    publisher = a.publisher("t/gone")
    publisher.close()
    with pytest.raises(BusError, match="closed"):
        publisher.put(b"")
