"""Pulled and plugged in again and again, a device always comes back, leaves nothing behind and disturbs nobody."""

import threading
from pathlib import Path

from bridge.config.schema import Bridge
from bridge.ingest.pump import Pump
from bridge.sim.pty_port import PtyPort
from bridge.sim.virtual_device import demo_device
from bridge.wire import keys
from tests.bridge.ingest.published.hearing import Listener, native, unbroken
from tests.memory_bus import MemoryBroker, MemoryBus


def test_a_device_that_is_pulled_often_always_comes_back(tmp_path: Path) -> None:
    broker = MemoryBroker()
    listener = Listener(broker)

    def there() -> bool:
        return dict(listener.alive).get(
            keys.build("w", "alive/device", device="pulled", boot=keys.boot_id(boot)), False
        )

    with (
        PtyPort(demo_device("pulled", 1), tmp_path / "pulled") as port,
        PtyPort(demo_device("beside", 2), tmp_path / "beside", lossless=True) as two,
    ):
        boot = port.device.boot or 0
        devices = native(port, "pulled"), native(two, "beside")
        with MemoryBus(broker) as bus, Pump("w", Bridge(id="b1", batch_ms=20, devices=devices), bus):
            listener.until(lambda: bool(there() and listener.count("pulled") and listener.count("beside")))
            files, threads = _open_files(), threading.active_count()
            for _ in range(20):
                port.unplug()
                listener.until(lambda: not there())
                heard = listener.count("pulled")
                port.plug()
                listener.until(lambda heard=heard: there() and listener.count("pulled") > heard)  # type: ignore[misc]
            # What an earlier test has left may end meanwhile.
            listener.until(lambda: _open_files() <= files and threading.active_count() <= threads)
    assert len(listener.batches["beside"]) > 20
    assert unbroken(listener.batches["beside"])
    listener.close()


def _open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))
