"""What the bus does not take is counted, bounded, and merged whole."""

from typing import Any

import pytest

from bridge.bus.contract import BusError, Publisher
from bridge.ingest.device_thread import DeviceThread
from bridge.ingest.intake import Intake
from bridge.ingest.merge_batches import merged
from bridge.ingest.pump import DevicePublisher
from bridge.wire.messages import SampleFlag
from tests.bridge.ingest.published.hearing import Listener
from tests.bridge.ingest.published.scripted import HELLO, Scripted, run, said
from tests.memory_bus import MemoryBroker, MemoryBus


class Failing:
    """A bus whose publishers of samples take two more messages, then fail, until they are mended."""

    def __init__(self, bus: MemoryBus) -> None:
        self._bus = bus
        self.left = 2

    def publisher(self, key: str, *, cache: int = 0) -> Publisher:
        made = self._bus.publisher(key, cache=cache)
        if "/raw/" not in key:
            return made
        put = made.put

        def some(payload: bytes) -> None:
            if not self.left:
                raise BusError("full")
            self.left -= 1
            put(payload)

        made.put = some  # type: ignore[method-assign]
        return made

    def __getattr__(self, name: str) -> Any:
        return getattr(self._bus, name)


def test_only_what_was_not_put_is_lost_when_the_bus_fails(broker: MemoryBroker, listener: Listener) -> None:
    holes = [said(sequence) for sequence in (0, 20, 40, 60)]  # four batches that do not merge
    link = run(driver := Scripted([HELLO], holes), lambda _: not driver._script)
    with MemoryBus(broker) as bus:
        outlet = DevicePublisher(Failing(bus), "w", "b1", "d1", 10)
        with pytest.raises(BusError, match="full"):
            outlet.publish(link.take(), 0.0)
        assert [batch.sequence for batch in outlet.unsent] == [40, 60]
        link.lose(outlet.unsent)
        outlet.publish(link.take(), 1.0, last=True)
        listener.hear()
    assert listener.infos["d1"].samples == listener.count() == 20
    assert listener.infos["d1"].dropped == {"overflow": 20}


def test_what_nobody_takes_is_bounded_and_counted() -> None:
    driver = Scripted([HELLO], *[[said(500 * i, 500)] for i in range(60)])

    def finished(link: DeviceThread) -> bool:
        return not driver._script

    taken = run(driver, finished).take()
    info = taken.info
    assert info is not None
    assert sum(map(len, taken.batches)) == 20_000 == info.samples
    assert info.dropped == {"overflow": 10_000}


def test_merging_keeps_every_sample_and_every_edge() -> None:
    intake = Intake("d1", "b1", "x", "y")
    intake.take(HELLO)
    events = [said(0), said(10), said(25), said(35)]
    batches = [batch for event in events for batch in intake.take(event)]
    one, two = merged(batches)
    assert (one.sequence, len(one), two.sequence, len(two)) == (0, 20, 25, 20)
    assert one.ticks.tolist() == [i * 10_000 for i in range(20)]
    assert one.receive_time_ns == batches[1].receive_time_ns
    assert one.start_time_ns == batches[0].start_time_ns
    assert two.flags.tolist() == [SampleFlag.AFTER_GAP] + [0] * 19
    assert merged([]) == []
