"""A router that goes and comes back: what is cached is not lost, what is lost is counted."""

import time

import pytest

from bridge.bus.contract import Bus
from tests.bridge.bus.worlds import World, collect, eventually, meet, numbers


@pytest.mark.parametrize("prompt", [True, False])
def test_an_outage_loses_nothing_that_is_cached(world: World, a: Bus, b: Bus, *, prompt: bool) -> None:
    publisher, subscription = a.publisher("t/outage", cache=1000), b.subscribe("t/outage", history=True, prompt=prompt)
    meet(publisher, subscription)
    for n in range(100):
        publisher.put(b"%d" % n)
    first = collect(subscription, 100)
    world.stop()
    eventually(lambda: not (a.connected or b.connected))
    for n in range(100, 200):
        publisher.put(b"%d" % n)
    world.start()
    eventually(lambda: a.connected and b.connected)
    for n in range(200, 300):
        publisher.put(b"%d" % n)
    assert numbers(first + collect(subscription, 200)) == list(range(300))
    assert subscription.missed == 0


@pytest.mark.parametrize("key", ["t/last", "t/@v1/last"])  # zenoh itself cannot repair the second
@pytest.mark.parametrize("later_s", [0.0, 0.6])
def test_the_last_message_of_an_outage_arrives_though_nothing_follows(
    world: World, a: Bus, b: Bus, key: str, later_s: float
) -> None:
    publisher, subscription = a.publisher(key, cache=10), b.subscribe(key, history=True)
    meet(publisher, subscription)
    world.stop()
    eventually(lambda: not (a.connected or b.connected))
    publisher.put(b"2")
    time.sleep(later_s)
    world.start()
    assert numbers(collect(subscription, 1)) == [2]


def test_what_is_put_as_the_router_comes_back_arrives_though_nothing_follows(world: World, a: Bus, b: Bus) -> None:
    publisher, subscription = a.publisher("t/@v1/last", cache=10), b.subscribe("t/@v1/*", history=True)
    meet(publisher, subscription)
    for n in range(2, 12, 2):
        world.stop()
        eventually(lambda: not (a.connected or b.connected))
        publisher.put(b"%d" % n)
        world.start()
        eventually(lambda: a.connected and b.connected)
        publisher.put(b"%d" % (n + 1))  # who listens is not known yet
        assert numbers(collect(subscription, 2)) == [n, n + 1]
    assert subscription.missed == 0


def test_what_an_outage_took_for_good_is_counted(world: World, a: Bus, b: Bus) -> None:
    publisher, subscription = a.publisher("t/lost", cache=10), b.subscribe("t/lost", history=True)
    meet(publisher, subscription)
    world.stop()
    eventually(lambda: not (a.connected or b.connected))
    for n in range(1, 101):
        publisher.put(b"%d" % n)
    world.start()
    assert numbers(collect(subscription, 10)) == list(range(91, 101))
    eventually(lambda: subscription.missed == 90)
    assert subscription.missed_by_key == {"t/lost": 90}


def test_an_outage_does_not_close_a_subscription(world: World, a: Bus) -> None:
    subscription = a.subscribe("t/open")
    world.stop()
    eventually(lambda: not a.connected)
    assert not subscription.closed
    world.start()
    assert not subscription.closed
