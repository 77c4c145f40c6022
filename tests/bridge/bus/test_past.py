"""Who comes later has the past, as much as is asked for and there is room for."""

import threading
import time

import pytest

from bridge.bus.contract import Bus
from tests.bridge.bus.worlds import World, collect, eventually, numbers, settled


def test_who_joins_busy_publishers_has_their_past(world: World, a: Bus) -> None:
    publishers = [a.publisher(f"t/busy/{n}", cache=1000) for n in range(20)]
    with world.bus() as early:
        subscription = early.subscribe("t/busy/*", history=True)
        for n in range(50):
            for publisher in publishers:
                publisher.put(b"%d" % n)
        assert len(collect(subscription, 1000)) == 1000
    stop, sent = threading.Event(), [50]

    def go_on() -> None:
        while not stop.is_set() and sent[0] < 900:
            for publisher in publishers:
                publisher.put(b"%d" % sent[0])
            sent[0] += 1
            time.sleep(0.001)

    busy = threading.Thread(target=go_on)
    busy.start()
    try:
        for _ in range(5):
            with world.bus() as late:
                subscription = late.subscribe("t/busy/*", history=True)
                got: dict[str, list[int]] = {}
                while len(got) < len(publishers) or min(map(len, got.values())) < 60:
                    for key, payload in subscription.drain(1000, 1.0):
                        got.setdefault(key, []).append(int(payload))
                assert [found for found in got.values() if found != list(range(len(found)))] == []
                assert subscription.missed == 0
    finally:
        stop.set()
        busy.join()


@pytest.mark.parametrize("prompt", [True, False])
def test_a_late_joiner_gets_history_then_live(a: Bus, b: Bus, *, prompt: bool) -> None:
    publisher = a.publisher("t/late", cache=100)
    for n in range(150):
        publisher.put(b"%d" % n)
    settled(a, b)  # what is still on its way to the router would come as live
    subscription = b.subscribe("t/*", history=True, prompt=prompt)
    assert numbers(collect(subscription, 100)) == list(range(50, 150))
    for n in range(150, 160):
        publisher.put(b"%d" % n)
    assert numbers(collect(subscription, 10)) == list(range(150, 160))
    assert subscription.missed == 0


def test_a_past_that_a_queue_has_no_room_for_comes_whole(a: Bus, b: Bus) -> None:
    publishers = [a.publisher(f"t/past/{n}", cache=50) for n in range(2)]
    for number in range(50):
        for publisher in publishers:
            publisher.put(str(number).encode())
    settled(a, b)  # what is still under way would come as news
    subscription = b.subscribe("t/past/*", history=True, capacity=10)
    eventually(lambda: subscription.caught_up)  # all of it is there before any is read
    past = collect(subscription, 100)
    assert [numbers([m for m in past if m.key.endswith(str(n))]) for n in range(2)] == [list(range(50))] * 2
    assert subscription.missed == 0
    publishers[0].put(b"50")  # while a bus learns a key a message may get lost, and come as the past
    assert numbers(collect(subscription, 1)) == [50]
    for number in range(51, 101):
        publishers[0].put(str(number).encode())
    eventually(lambda: subscription.missed == 40)
    assert numbers(subscription.drain(100, 0.0)) == list(range(91, 101)), "its own length counts again"


def test_of_the_past_as_much_comes_as_is_asked_for_and_all_that_follows(a: Bus, b: Bus) -> None:
    publishers = [a.publisher(f"t/some/{n}", cache=50) for n in range(2)]
    for number in range(50):
        for publisher in publishers:
            publisher.put(str(number).encode())
    settled(a, b)  # what is still under way would come as news
    subscription = b.subscribe("t/some/*", history=True, most_past=7)
    came = collect(subscription, 14)
    for publisher in publishers:
        publisher.put(b"50")
    came += collect(subscription, 2)
    assert [numbers([m for m in came if m.key.endswith(str(n))]) for n in range(2)] == [list(range(43, 51))] * 2
    assert subscription.missed == 0
