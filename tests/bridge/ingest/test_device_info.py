"""A DeviceInfo is published at a new boot, soon after a change, and once a second."""

from dataclasses import replace

from bridge.ingest.device_thread import Taken
from bridge.ingest.intake import Intake
from bridge.ingest.pump import DevicePublisher
from bridge.wire import keys
from tests.memory_bus import MemoryBroker, MemoryBus


def test_a_device_info_is_published_after_a_change_and_once_a_second() -> None:
    broker = MemoryBroker()
    with MemoryBus(broker) as bus:
        heard = bus.subscribe(keys.pattern("w", "info"))
        publisher = DevicePublisher(bus, "w", "b1", "d1", 1)
        first = replace(Intake("d1", "b1", "scripted", "script").info(10**18, {}), boot=7)
        changed = replace(first, events={"gaps": 1})
        for at_s, info, published in [
            (100.0, first, 1),
            (100.3, first, 0),
            (100.5, changed, 1),
            (100.7, replace(changed, samples=9), 0),
            (101.6, changed, 1),
            (101.7, replace(changed, boot=8), 1),
            (101.8, None, 0),
        ]:
            publisher.publish(Taken([], 7, True, info), at_s)
            assert len(heard.drain(10, 0.05)) == published, at_s
    assert [publisher.looks(at_s) for at_s in (5.0, 5.1, 5.3)] == [True, False, True]
