"""Subscriptions that are read as one lose nothing that each by itself would not."""

import time

from bridge.bus.contract import Message
from bridge.bus.memory_bus import MemoryBroker, MemoryBus
from bridge.bus.together import Together


def test_of_a_past_that_a_reader_has_no_room_for_nothing_is_lost_and_of_the_present_what_would_be_anyway() -> None:
    bus, keys, n = MemoryBus(MemoryBroker()), ("w/a", "w/b"), 640
    publishers = {key: bus.publisher(key, cache=n) for key in keys}
    for number in range(n):
        for publisher in publishers.values():
            publisher.put(str(number).encode())
    together = Together([bus.subscribe(key, history=True, capacity=100) for key in keys], 100)
    came = list[Message]()
    while len(came) < 2 * n and (taken := together.drain(64, 5.0)):
        came += taken
    assert {key: [int(payload) for of, payload in came if of == key] for key in keys} == {
        key: list(range(n)) for key in keys
    }
    assert together.overflowed == 0
    for number in range(n):
        for publisher in publishers.values():
            publisher.put(str(number).encode())
    left = 0
    while taken := together.drain(64, 0.5):
        left += len(taken)
    assert left + together.overflowed == 2 * n
    assert together.overflowed > 0
    together.close()


def test_who_closes_it_while_nobody_reads_ends_what_reads_ahead() -> None:
    broker = MemoryBroker()
    sending, reading = MemoryBus(broker), MemoryBus(broker)
    publishers = [sending.publisher(key) for key in ("w/a", "w/b")]
    together = Together([reading.subscribe(key, capacity=10) for key in ("w/a", "w/b")], 10)
    for _ in range(100):
        for publisher in publishers:
            publisher.put(b"")
    reading.close()
    until = time.monotonic() + 5.0
    while not together.closed:
        assert time.monotonic() < until
        time.sleep(0.01)
