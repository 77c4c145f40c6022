"""Subscribers of the demonstration: three count every corrected sample, one follows raw samples and status."""

import math
import threading
import time
from collections import defaultdict

from bridge.bus.contract import Bus
from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import codec, keys
from bridge.wire.messages import CorrectedBatch, SampleBatch, State, Status
from estimator.client import Client
from estimator.client.decoder import Decoder

Boot = tuple[str, int]
DRAIN_S = 2.0
#: s between checks for the end, and of silence after which all samples have come, on a busy machine too
_LOOK_S, _QUIET_S = 0.2, 1.0


class Subscriber:
    """Subscriber that counts corrected samples by device and boot in its own thread.

    endpoint: address of the router. keep: True also stores the batches in `batches`.
    """

    def __init__(self, endpoint: str, ward: str, *, keep: bool = False) -> None:
        self._client = Client((endpoint,), ward=ward)
        self._corrected = self._client.corrected()
        self._keep = keep
        self._until = math.inf
        self.batches: dict[Boot, list[CorrectedBatch]] = defaultdict(list)
        self.received: dict[Boot, int] = defaultdict(int)
        self.last: dict[Boot, int] = {}
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def troubles(self) -> str:
        """Faults of the received messages, in words: missed messages, repeated samples, refused messages.

        Empty without faults.
        """
        c = self._corrected
        found = {"missed messages": c.missed, "repeated samples": c.repeated, **c.refused}
        return ", ".join(f"{count} {what}" for what, count in found.items() if count)

    def close(self, drain_s: float = DRAIN_S) -> None:
        """Receive remaining messages for at most drain_s seconds, then stop the thread and the client."""
        self._until = time.monotonic() + drain_s
        self._thread.join()
        self._client.close()

    def _run(self) -> None:
        while True:
            closing = self._until < math.inf
            batch = self._corrected.receive(_QUIET_S if closing else _LOOK_S)
            if time.monotonic() > self._until or (batch is None and closing):
                return
            if batch is None:
                continue
            boot = batch.device, batch.boot
            self.received[boot] += len(batch)
            self.last[boot] = batch.sequence + len(batch) - 1
            if self._keep:
                self.batches[boot].append(batch)


class Watcher:
    """Subscriber that follows status and raw samples of the whole ward; call `poll` from one thread.

    endpoint: address of the router.
    """

    def __init__(self, endpoint: str, ward: str) -> None:
        self._bus: Bus = ZenohBus((endpoint,))
        self._status = self._bus.subscribe(keys.pattern(ward, "status"), history=True)
        self._raw = self._bus.subscribe(keys.pattern(ward, "raw"), history=True)
        self._status_door = Decoder[Status]("status", codec.decode_status)
        self._raw_door = Decoder[SampleBatch]("raw", codec.decode_samples)
        self.statuses: dict[str, Status] = {}
        self.raw: dict[Boot, list[SampleBatch]] = defaultdict(list)
        self.changes: list[Status] = []

    def poll(self) -> None:
        """Decode the status and raw sample messages that arrived since the last call, without waiting.

        Afterwards `statuses` has the latest Status by device id, and `raw` all SampleBatches by device id and boot.
        `changes` has each new Status whose state or boot differs from that before it.
        """
        self.changes = []
        for message in self._raw.drain(4096, 0.0):
            if (batch := self._raw_door.take(message)) is not None:
                self.raw[batch.device, batch.boot].append(batch)
        for message in self._status.drain(4096, 0.0):
            status = self._status_door.take(message)
            if status is None:
                continue
            before = self.statuses.get(status.device)
            if before is None or (before.state, before.boot) != (status.state, status.boot):
                self.changes.append(status)
            self.statuses[status.device] = status

    def all_tracking(self, devices: int) -> bool:
        """Return True if exactly this number of devices is calibrated and tracked."""
        return sum(status.state is State.TRACKING for status in self.statuses.values()) == devices

    def close(self) -> None:
        """Close the connection to the bus."""
        self._bus.close()
