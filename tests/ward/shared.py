"""Several estimators of one ward in this process, each with its own sessions, and a bridge; to be killed and held up."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from bridge.bus.contract import Bus
from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import codec, keys
from bridge.wire.messages import BootCause, CorrectedBatch, DeviceInfo, SampleBatch
from estimator.client import Client
from estimator.config.schema import Estimator
from estimator.service.run_loop import Service
from estimator.service.store import Store

WARD, BRIDGE = "shared", "b1"
RATE_HZ, SAMPLES = 100.0, 10


class Bridge:
    """Devices at rest, heard by a bridge, each with a boot of its own."""

    def __init__(self, bus: Bus, devices: list[str]) -> None:
        self.devices, self.sent = devices, 0
        cache = round(15 * RATE_HZ / SAMPLES)
        self._publishers = [
            bus.publisher(keys.build(WARD, "raw", bridge=BRIDGE, device=device), cache=cache) for device in devices
        ]
        self._infos = [
            bus.publisher(keys.build(WARD, "info", bridge=BRIDGE, device=device), cache=1) for device in devices
        ]
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        rng = np.random.default_rng(1)
        due = time.monotonic()
        while not self._stop.wait(max(0.0, due - time.monotonic())):
            due += SAMPLES / RATE_HZ
            now_ns = time.time_ns()
            ticks = (self.sent + 1 + np.arange(SAMPLES)).astype(np.uint64) * 10_000
            gyro = rng.normal(0.01, 1e-3, (SAMPLES, 3)).astype(np.float32)
            for boot, (device, publisher) in enumerate(zip(self.devices, self._publishers, strict=True), 1):
                batch = SampleBatch(
                    device, boot, self.sent, now_ns, now_ns, 1e-6, 1.0, ticks, gyro, None, None,
                    np.zeros(SAMPLES, np.uint32),
                )  # fmt: skip
                publisher.put(codec.encode_samples(batch))
            if self.sent % round(RATE_HZ) == 0:
                for boot, (device, publisher) in enumerate(zip(self.devices, self._infos, strict=True), 1):
                    publisher.put(codec.encode_info(_info(device, boot, now_ns)))
            self.sent += SAMPLES

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()


def _info(device: str, boot: int, now_ns: int) -> DeviceInfo:
    return DeviceInfo(
        device, BRIDGE, boot, BootCause.POWER_UP, "m", "1", "native", "p", RATE_HZ, RATE_HZ, 8.7, False, False, now_ns
    )  # fmt: skip


class Running:
    """An estimator on a thread of its own."""

    def __init__(self, name: str, bus: Callable[[], Bus], others: list[str]) -> None:
        self.name = name
        self._bus = bus()
        self.store = Store(":memory:")
        self.service = Service(WARD, Estimator(id=name), self._bus, self.store, peers=others)
        self._over, self._awake = threading.Event(), threading.Event()
        self._awake.set()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._over.is_set():
            self._awake.wait()
            if not self._over.is_set():
                self.service.step(0.02)

    @property
    def devices(self) -> set[str]:
        return set(self.service._devices)

    def hang(self) -> None:
        """Its connections live on."""
        self._awake.clear()

    def wake(self) -> None:
        self._awake.set()

    def kill(self) -> None:
        """Without a goodbye."""
        self._over.set()
        self._awake.set()
        self._thread.join()
        self._bus.close()


class Shared:
    """The whole of it; `taken` is what a subscriber was given."""

    def __init__(self, endpoint: str, devices: int) -> None:
        self._endpoint = endpoint
        self.names = [f"d{number:02d}" for number in range(devices)]
        self.running: dict[str, Running] = {}
        self.taken: list[CorrectedBatch] = []
        self._bus = self.bus()
        self.client = Client(ward=WARD, bus=self.bus())
        self.stream = self.client.corrected(wait_s=10.0)
        self.bridge = Bridge(self._bus, self.names)

    def bus(self) -> Bus:
        return ZenohBus([self._endpoint])

    def start(self, name: str) -> Running:
        made = self.running[name] = Running(name, self.bus, [*self.running])
        return made

    def kill(self, name: str) -> None:
        self.running.pop(name).kill()

    def until(self, true: Callable[[], bool], timeout_s: float = 90.0) -> None:
        """Take what comes until something is so."""
        deadline = time.monotonic() + timeout_s
        while not true():
            assert time.monotonic() < deadline, {name: sorted(one.devices) for name, one in self.running.items()}
            self.taken += self.stream.drain(0.05)

    def listen(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        self.until(lambda: time.monotonic() >= end, seconds + 30.0)

    @property
    def reached(self) -> int:
        """Samples of the device that is furthest behind."""
        came = dict.fromkeys(self.names, 0)
        for batch in self.taken:
            came[batch.device] = max(came[batch.device], batch.sequence + len(batch))
        return min(came.values())

    def split(self) -> list[int]:
        """How many devices each has."""
        return [len(one.devices) for one in self.running.values()]

    def settled(self) -> bool:
        """Whether each device is with one of them, and with no other."""
        had = sorted(name for one in self.running.values() for name in one.devices)
        return had == self.names

    def finish(self) -> None:
        """The bridge says no more, and all it said has come."""
        self.bridge.stop()
        self.until(lambda: self.reached >= self.bridge.sent)

    def close(self) -> None:
        self.bridge.stop()
        for one in self.running.values():
            one.kill()
        self.client.close()
        self._bus.close()


@contextmanager
def shared(endpoint: str, devices: int) -> Iterator[Shared]:
    made = Shared(endpoint, devices)
    try:
        yield made
    finally:
        made.close()
