"""One subscription over several patterns: one queue, and nothing of what no pattern names."""

import pytest

from bridge.bus.contract import Bus, BusError
from tests.bridge.bus.worlds import collect, eventually, meet, numbers


def test_several_patterns_come_in_one_queue_each_message_once(a: Bus, b: Bus) -> None:
    publishers = [a.publisher(f"t/{n}/x", cache=50) for n in range(4)]
    for number in range(20):
        for publisher in publishers:
            publisher.put(b"%d" % number)
    subscription = b.subscribe(["t/0/x", "t/2/*", "t/0/x", "t/none"], history=True)
    eventually(lambda: subscription.caught_up)
    for number in range(20, 40):
        for publisher in publishers:
            publisher.put(b"%d" % number)
    came = collect(subscription, 80)
    assert {m.key for m in came} == {"t/0/x", "t/2/x"}
    for key in ("t/0/x", "t/2/x"):
        assert numbers([m for m in came if m.key == key]) == list(range(40))
    assert subscription.missed == 0
    subscription.close()
    assert subscription.closed


@pytest.mark.parametrize("history", [False, True])
def test_a_flood_of_one_pattern_leaves_the_others_their_turn(a: Bus, b: Bus, history: bool) -> None:
    flood, quiet = a.publisher("t/flood", cache=5000 * history), a.publisher("t/quiet", cache=5 * history)
    subscription = b.subscribe(["t/flood", "t/quiet"], history=history)
    meet(flood, subscription)
    meet(quiet, subscription)
    for number in range(3000):
        flood.put(b"%d" % number)
    quiet.put(b"7")
    eventually(lambda: any(m == ("t/quiet", b"7") for m in subscription.drain(4000, 0.1)))


def test_no_pattern_is_refused(a: Bus) -> None:
    with pytest.raises(BusError, match="no pattern"):
        a.subscribe([])
