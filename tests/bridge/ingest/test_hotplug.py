"""Pulled and plugged in again and again, a device always comes back, leaves nothing behind and disturbs nobody."""

import threading
import time
from collections.abc import Callable
from pathlib import Path

from bridge.config.schema import Bridge, Device
from bridge.drivers.byte_stream import StreamOptions
from bridge.ingest.pump import Pump
from bridge.sim.pty_port import PtyPort
from bridge.sim.virtual_device import demo_device
from bridge.wire import codec, keys
from bridge.wire.messages import SampleBatch
from tests.memory_bus import MemoryBroker, MemoryBus

PULLED, BESIDE = "pulled", "beside"
_PATIENCE_S = 60.0


class Ears:
    """Hears the bus; `there` says whether the pulled device's token is."""

    def __init__(self, broker: MemoryBroker) -> None:
        self.there = False
        self.heard = 0
        self.beside: list[SampleBatch] = []
        self._bus = MemoryBus(broker)
        self._bus.watch_alive(keys.ROOT + f"/w/alive/device/{PULLED}/*", self._alive)
        self._raw = self._bus.subscribe(keys.pattern("w", "raw"), history=True)

    def until(self, condition: Callable[[], bool]) -> None:
        """Listen until then."""
        end = time.monotonic() + _PATIENCE_S
        while not condition():
            if time.monotonic() > end:
                raise TimeoutError("it did not come to pass")
            for message in self._raw.drain(1000, 0.01):
                batch = codec.decode_samples(*message)
                if batch.device == BESIDE:
                    self.beside.append(batch)
                else:
                    self.heard += 1

    def close(self) -> None:
        self._bus.close()

    def _alive(self, _: str, there: bool) -> None:
        self.there = there


def test_a_device_that_is_pulled_often_always_comes_back(tmp_path: Path) -> None:
    broker = MemoryBroker()
    ears = Ears(broker)
    with (
        PtyPort(demo_device(PULLED, 1), tmp_path / PULLED) as port,
        PtyPort(demo_device(BESIDE, 2), tmp_path / BESIDE, lossless=True) as two,
    ):
        devices = tuple(
            Device(name, "native", StreamOptions(port=str(p.link))) for name, p in ((PULLED, port), (BESIDE, two))
        )
        with MemoryBus(broker) as bus, Pump("w", Bridge(id="b1", batch_ms=20, devices=devices), bus):
            ears.until(lambda: bool(ears.there and ears.heard and ears.beside))
            before = _open_files(), threading.active_count()
            for _ in range(20):
                port.unplug()
                ears.until(lambda: not ears.there)
                heard = ears.heard
                port.plug()
                ears.until(lambda heard=heard: ears.there and ears.heard > heard)  # type: ignore[misc]
            assert (_open_files(), threading.active_count()) == before
    assert len(ears.beside) > 20
    ends = [batch.sequence + len(batch) for batch in ears.beside]
    assert [batch.sequence for batch in ears.beside[1:]] == ends[:-1], "nothing missing, nothing twice"
    ears.close()


def _open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))
