"""Counts what comes out, whoever sent it: messages, samples each once, and how long each message was on its way."""

import threading
import time
from collections import Counter

import numpy as np
from google.protobuf.message import Message

from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import columns_pb2 as columns
from bridge.wire import keys
from tests.bench.load.stream import WARD


class Receiver:
    """A subscriber with a thread of its own. `relayed`: what comes is the raw message itself."""

    def __init__(self, endpoint: str, *, relayed: bool) -> None:
        self._kind: type[Message] = columns.SampleBatch if relayed else columns.CorrectedBatch
        self._bus = ZenohBus([endpoint])
        self._subscription = self._bus.subscribe(keys.pattern(WARD, "corrected"), history=True, capacity=1 << 20)
        self._arrived: list[tuple[int, bytes]] = []
        self.count = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.is_set():
            messages = self._subscription.drain(512, 0.05)
            now_ns = time.time_ns()
            self._arrived += [(now_ns, message.payload) for message in messages]
            self.count += len(messages)

    def result(self) -> tuple[int, int, int, np.ndarray[tuple[int], np.dtype[np.float64]]]:
        """Messages; samples; samples beyond the first of the same device and number; latency of each message, s."""
        seen: dict[str, set[int]] = {}
        samples = twice = 0
        latency = np.empty(len(self._arrived))
        for at, (arrived_ns, payload) in enumerate(self._arrived):
            batch = self._kind.FromString(payload)
            n = len(batch.ticks) // 8  # type: ignore[attr-defined]
            first = batch.sequence  # type: ignore[attr-defined]
            known = seen.setdefault(batch.device, set())  # type: ignore[attr-defined]
            fresh = set(range(first, first + n)) - known
            known |= fresh
            samples += len(fresh)
            twice += n - len(fresh)
            latency[at] = (arrived_ns - batch.start_time_ns) * 1e-9  # type: ignore[attr-defined]
        return len(self._arrived), samples, twice, latency

    def whole(self, rate_hz: float, seconds: float = 20.0) -> int:
        """Of how many devices nothing is missing in the last seconds that anything came of."""
        came = [self._kind.FromString(payload) for _, payload in self._arrived]
        end_ns = max(batch.start_time_ns for batch in came)  # type: ignore[attr-defined]
        samples = Counter[str]()
        for batch in came:
            if -seconds <= (batch.start_time_ns - end_ns) * 1e-9 < -1.0:  # type: ignore[attr-defined]
                samples[batch.device] += len(batch.ticks) // 8  # type: ignore[attr-defined]
        return sum(n >= 0.99 * rate_hz * (seconds - 1.0) for n in samples.values())

    def close(self) -> None:
        """End the thread and the session."""
        self._stop.set()
        self._thread.join()
        self._bus.close()
