"""Messages: in order and once, a queue that is full, waiting for one."""

import threading

import pytest

from bridge.bus.contract import Bus
from tests.bridge.bus.worlds import collect, eventually, meet, numbers


@pytest.mark.parametrize("prompt", [True, False])
def test_messages_arrive_in_order_and_once(a: Bus, b: Bus, *, prompt: bool) -> None:
    publisher, subscription = a.publisher("t/order"), b.subscribe("t/order", prompt=prompt)
    meet(publisher, subscription)
    for n in range(2000):
        publisher.put(b"%d" % n)
    assert numbers(collect(subscription, 2000)) == list(range(2000))
    assert subscription.missed == 0


def test_a_bus_hears_itself(a: Bus) -> None:
    subscription = a.subscribe("t/**")
    a.publisher("t/self").put(b"1")
    assert subscription.receive(30.0) == ("t/self", b"1")


def test_a_full_queue_drops_its_oldest_and_counts_it(a: Bus, b: Bus) -> None:
    publisher, slow, quick = a.publisher("t/full"), b.subscribe("t/full", capacity=10), b.subscribe("t/full")
    meet(publisher, slow)
    meet(publisher, quick)
    publisher.put(b"begin")
    for one in (slow, quick):
        while (message := one.receive(60.0)) is not None and message.payload != b"begin":
            pass
    missed = slow.missed
    for n in range(1000):
        publisher.put(b"%d" % n)
    assert numbers(collect(quick, 1000)) == list(range(1000))
    eventually(lambda: slow.missed - missed == 990)
    assert slow.missed_by_key == {"t/full": slow.missed}
    assert numbers(slow.drain(100, 1.0)) == list(range(990, 1000))


def test_drain_takes_no_more_than_its_limit(a: Bus) -> None:
    publisher, subscription = a.publisher("t/limit", cache=10), a.subscribe("t/limit")
    meet(publisher, subscription)
    for n in range(10):
        publisher.put(b"%d" % n)
    got = subscription.drain(4, 2.0)
    assert 1 <= len(got) <= 4
    assert numbers(got + collect(subscription, 10 - len(got))) == list(range(10))


def test_a_publisher_knows_whether_it_is_wanted(a: Bus, b: Bus) -> None:
    plain = a.publisher("truerate/@v1/w/@windowed/d1")
    assert not plain.wanted
    assert a.publisher("truerate/@v1/w/status/d1", cache=1).wanted
    everything = b.subscribe("truerate/@v1/w/**")
    other = b.subscribe("truerate/@v1/w/@windowed/d2")
    for pattern in ("truerate/@v1/w/@windowed/*", "truerate/@v1/w/@windowed/d1"):
        asked = b.subscribe(pattern)
        eventually(lambda: plain.wanted)
        asked.close()
        eventually(lambda: not plain.wanted)
    for one in (everything, other):
        one.close()
    plain.close()


@pytest.mark.parametrize("cache", [0, 5000])
def test_several_threads_may_publish_at_once(a: Bus, b: Bus, cache: int) -> None:
    publisher, subscription = a.publisher("t/threads", cache=cache), b.subscribe("t/threads", history=bool(cache))
    meet(publisher, subscription)

    def run(of: int) -> None:
        for n in range(500):
            publisher.put(b"%d" % (of * 1000 + n))

    threads = [threading.Thread(target=run, args=(of,)) for of in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    got = numbers(collect(subscription, 2000))
    assert len(got) == 2000
    for of in range(4):
        assert [n % 1000 for n in got if n // 1000 == of] == list(range(500))
