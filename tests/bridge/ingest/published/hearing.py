"""What a bridge publishes, and who hears it."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from bridge.config.schema import Bridge, Device
from bridge.drivers.byte_stream import StreamOptions
from bridge.ingest.pump import Pump
from bridge.sim.pty_port import PtyPort
from bridge.sim.virtual_device import demo_device
from bridge.wire import codec, keys
from bridge.wire.messages import DeviceInfo, SampleBatch
from tests.memory_bus import MemoryBroker, MemoryBus


class Listener:
    """A subscriber that keeps what it hears."""

    def __init__(self, broker: MemoryBroker) -> None:
        self.batches: dict[str, list[SampleBatch]] = defaultdict(list)
        self.infos: dict[str, DeviceInfo] = {}
        self.alive: list[tuple[str, bool]] = []
        self._bus = MemoryBus(broker)
        self._bus.watch_alive(keys.ROOT + "/w/alive/**", lambda key, alive: self.alive.append((key, alive)))
        self._raw = self._bus.subscribe(keys.pattern("w", "raw"), history=True)
        self._info = self._bus.subscribe(keys.pattern("w", "info"), history=True)

    def hear(self) -> None:
        for message in self._info.drain(1000, 0.0):
            info = codec.decode_info(*message)
            self.infos[info.device] = info
        for message in self._raw.drain(1000, 0.01):
            batch = codec.decode_samples(*message)
            self.batches[batch.device].append(batch)

    def until(self, condition: Callable[[], bool], limit_s: float = 60.0) -> None:
        end = time.monotonic() + limit_s
        while not condition():
            assert time.monotonic() < end, "it did not come to pass"
            self.hear()

    def count(self, device: str = "d1") -> int:
        return sum(len(batch) for batch in self.batches[device])

    def close(self) -> None:
        self._bus.close()


def native(port: PtyPort, name: str = "d1") -> Device:
    return Device(name, "native", StreamOptions(port=str(port.link)))


@contextmanager
def published(tmp_path: Path, broker: MemoryBroker) -> Iterator[PtyPort]:
    """One device d1 on a terminal, and the bridge that reads it."""
    with PtyPort(demo_device("d1", 1), tmp_path / "d1", lossless=True) as port:
        config = Bridge(id="b1", batch_ms=20, devices=(native(port),))
        with MemoryBus(broker) as bus, Pump("w", config, bus):
            yield port


def unbroken(batches: list[SampleBatch]) -> bool:
    """No sample lost, none twice."""
    ends = [batch.sequence + len(batch) for batch in batches]
    return all(batch.sequence == end for batch, end in zip(batches[1:], ends, strict=False))


def accounted(listener: Listener, device: str) -> bool:
    return listener.infos[device].samples == listener.count(device)
