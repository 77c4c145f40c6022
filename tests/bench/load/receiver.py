"""Keeps what comes out, whoever sent it, and when: messages, samples each once, and how long each message was on its way."""

import threading
import time
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np

from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import columns_pb2 as columns
from bridge.wire import keys
from tests.bench.load.stream import WARD


class Receiver(threading.Thread):
    """A subscriber of corrected rates with a thread of its own. `relayed`: what comes is the raw message itself."""

    def __init__(self, endpoint: str, *, relayed: bool = False) -> None:
        super().__init__(daemon=True)
        self._kind = columns.SampleBatch if relayed else columns.CorrectedBatch
        self._bus = ZenohBus([endpoint])
        self._subscription = self._bus.subscribe(keys.pattern(WARD, "corrected"), history=True, capacity=1 << 20)
        #: of each message the host time in ns, its key and payload
        self.heard: list[tuple[int, str, bytes]] = []
        self._over = threading.Event()
        self.start()

    def run(self) -> None:
        while not self._over.is_set():
            messages = self._subscription.drain(512, 0.05)
            now_ns = time.time_ns()
            self.heard += [(now_ns, message.key, message.payload) for message in messages]

    def batches(self) -> Iterator[tuple[int, Any]]:
        """Each message and when it came, ns."""
        for came_ns, _, payload in self.heard:
            yield came_ns, self._kind.FromString(payload)

    def samples(self) -> Counter[str]:
        """Of each device how many samples came, each counted once."""
        numbers: dict[str, set[int]] = {}
        for _, batch in self.batches():
            n = len(batch.ticks) // 8
            numbers.setdefault(batch.device, set()).update(range(batch.sequence, batch.sequence + n))
        return Counter({device: len(of) for device, of in numbers.items()})

    def latency_s(self) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """(messages,) of each the time from its sender's put."""
        return np.array([came_ns - batch.start_time_ns for came_ns, batch in self.batches()]) * 1e-9

    def whole(self, rate_hz: float, seconds: float = 20.0) -> int:
        """Of how many devices nothing is missing in the last seconds that anything came of."""
        came = [batch for _, batch in self.batches()]
        end_ns = max(batch.start_time_ns for batch in came)
        samples = Counter[str]()
        for batch in came:
            if -seconds <= (batch.start_time_ns - end_ns) * 1e-9 < -1.0:
                samples[batch.device] += len(batch.ticks) // 8
        return sum(n >= 0.99 * rate_hz * (seconds - 1.0) for n in samples.values())

    def close(self) -> None:
        """End the thread and the session."""
        self._over.set()
        self.join()
        self._bus.close()
