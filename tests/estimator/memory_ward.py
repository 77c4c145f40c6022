"""A service over the bus in memory, fed with a simulated device; its rounds are made by the test itself."""

import threading
import time
from collections.abc import Callable
from pathlib import Path

from bridge.bus.contract import Subscription
from bridge.wire import codec, keys
from bridge.wire.messages import CommandReply, DeviceInfo, SampleBatch, Status
from estimator.client import Client, Corrected
from estimator.config.schema import Estimator
from estimator.database import Database
from estimator.service.run_loop import Service
from estimator.service.store import Store
from estimator.service.store_writer import StoreWriter
from tests.estimator.stream import NAME
from tests.memory_bus import MemoryBroker, MemoryBus

WARD = "w"
SILENCE_S = 100.0  # a busy machine stands still for seconds
SETTINGS = Estimator(id="e1", silence_s=SILENCE_S)


class Ward:
    """A broker with one estimator, which may be restarted, and a bridge's publishers."""

    def __init__(self, folder: Path) -> None:
        self.broker = MemoryBroker()
        self.now_ns = 1_700_000_000_000_000_000
        self.path = folder / "store.sqlite3"
        self._bridge = MemoryBus(self.broker)
        self._raw = self._bridge.publisher(keys.build(WARD, "raw", bridge="bridge", device=NAME), cache=64)
        self._info = self._bridge.publisher(keys.build(WARD, "info", bridge="bridge", device=NAME), cache=1)
        self.client = Client(ward=WARD, bus=MemoryBus(self.broker))
        self.subscriber: Corrected = self.client.corrected(idle_s=0.05)
        self.status: Subscription = MemoryBus(self.broker).subscribe(keys.pattern(WARD, "status"))
        self.start()

    def start(self, clerk: Callable[[Database], StoreWriter | None] = lambda _: None) -> None:
        self.store = Store(self.path, patient=True)
        self._bus = MemoryBus(self.broker)
        writes = clerk(self.store.database)
        self.service = Service(WARD, SETTINGS, self._bus, self.store, now_ns=lambda: self.now_ns, clerk=writes)

    def kill(self) -> None:
        """Nothing is said or written any more; what was written is there."""
        self._bus.close()
        self.store.close()

    def stop(self) -> None:
        """The estimator is stopped in order."""
        stop = threading.Event()
        stop.set()
        self.service.run(stop)
        self.kill()

    def send(self, batches: list[SampleBatch], of: DeviceInfo | None = None) -> None:
        if of is not None:
            self._info.put(codec.encode_info(of))
        for start in range(0, len(batches), 100):
            for batch in batches[start : start + 100]:
                self._raw.put(codec.encode_samples(batch))
            self.service.step(0.0)
        self.settle()

    def settle(self) -> None:
        """Until nothing waits any more."""
        while self.service.step(0.0):
            pass

    def put(self, payload: bytes, **ids: str) -> None:
        MemoryBus(self.broker).publisher(keys.build(WARD, "raw", **ids), cache=0).put(payload)
        self.settle()

    def latest(self) -> Status:
        """The status, published anew."""
        self.service._every_second(time.monotonic())
        self.service.work()
        message = self.status.drain(100_000, 0.5)[-1]
        return codec.decode_status(message.key, message.payload)

    def command(self, ask: Callable[[], CommandReply]) -> CommandReply:
        """Ask from another thread while the service makes its rounds."""
        replies: list[CommandReply] = []
        thread = threading.Thread(target=lambda: replies.append(ask()))
        thread.start()
        while thread.is_alive():
            self.service.step(0.005)
        thread.join()
        return replies[0]
