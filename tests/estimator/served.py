"""A service by itself: messages are put before it in rounds, and what it publishes of rates is kept. No disk."""

from collections.abc import Iterable
from types import TracebackType
from typing import Self

import numpy as np
import pytest

from bridge.bus.contract import Message
from bridge.config.enrolment import Enrolment
from bridge.wire import codec, keys
from bridge.wire.messages import CorrectedBatch, DeviceInfo, SampleBatch
from estimator.config.schema import Estimator
from estimator.service.run_loop import Service
from estimator.service.store import Store
from tests.memory_bus import MemoryBroker, MemoryBus

WARD, BRIDGE = "w", "bridge"
NOW_NS = 1_700_000_100_000_000_000


class Kept(MemoryBus):
    """A bus that keeps what is published of rates."""

    def __init__(self) -> None:
        super().__init__(MemoryBroker())
        self.said: list[tuple[str, bytes]] = []

    def publisher(self, key: str, *, cache: int = 0) -> "Pen":  # type: ignore[override]
        return Pen(key, self.said)


class Pen:
    wanted = False

    def __init__(self, key: str, said: list[tuple[str, bytes]]) -> None:
        self._key, self._said = key, said

    def put(self, payload: bytes) -> None:
        if "/corrected/" in self._key:
            self._said.append((self._key, payload))

    def close(self) -> None:
        pass


class Before:
    """A subscription to what was laid before it."""

    missed, caught_up, closed = 0, True, False

    def __init__(self) -> None:
        self.messages: list[Message] = []

    def drain(self, limit: int, timeout_s: float) -> list[Message]:
        drained, self.messages = self.messages[:limit], self.messages[limit:]
        return drained

    def close(self) -> None:
        pass


class Served:
    """A service whose steady clock stands still but for `pass_`; from `with` to its end."""

    def __init__(
        self, enrolment: Enrolment | None = None, store: Store | None = None, settings: Estimator | None = None
    ) -> None:
        self._patch = pytest.MonkeyPatch()
        self.now = 1000.0
        self._settings = settings or Estimator(id="e", silence_s=2.0)
        self._bus = Kept()
        self._own, self._enrolment = store is None, enrolment
        self.store = store or Store(":memory:")
        self.raw, self.info = Before(), Before()

    def __enter__(self) -> Self:
        self._patch.setattr("estimator.service.run_loop.time.monotonic", lambda: self.now)
        self.service = Service(WARD, self._settings, self._bus, self.store, lambda: NOW_NS, enrolment=self._enrolment)
        self.service._raw, self.service._info = self.raw, self.info  # type: ignore[assignment]
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for thing in self.service._declared:
            thing.close()
        self._bus.close()
        if self._own:
            self.store.close()
        self._patch.undo()

    def put(self, batch: SampleBatch, bridge: str = BRIDGE) -> None:
        """Lay samples before it."""
        key = keys.build(WARD, "raw", bridge=bridge, device=batch.device)
        self.raw.messages.append(Message(key, codec.encode_samples(batch)))

    def tell(self, info: DeviceInfo) -> None:
        key = keys.build(WARD, "info", bridge=BRIDGE, device=info.device)
        self.info.messages.append(Message(key, codec.encode_info(info)))

    def token(self, boot: int, device: str, *, alive: bool) -> None:
        self.service._presence.change(keys.build(WARD, "alive/device", device=device, boot=keys.boot_id(boot)), alive)

    def round(self, passed_s: float = 0.0) -> list[CorrectedBatch]:
        """One round of the service after so long; what it publishes in it."""
        self.now += passed_s
        self.service.step(0.0)
        return self.published()

    def published(self) -> list[CorrectedBatch]:
        said = self._bus.said[:]
        self._bus.said.clear()
        return [codec.decode_corrected(key, payload) for key, payload in said]


def numbers(batches: Iterable[CorrectedBatch]) -> list[tuple[int, int]]:
    """Boot and number of each sample."""
    return [(b.boot, b.sequence + i) for b in batches for i in range(len(b))]


def columns(batches: list[CorrectedBatch]) -> tuple[bytes, ...]:
    """All that is published of each sample, but for where batches were cut."""
    lengths = [len(b) for b in batches]
    spread = [
        np.repeat(np.array([getattr(b, name) for b in batches]), lengths, axis=0).tobytes()
        for name in ("boot", "noise_std", "bias_std", "scale_std", "cross_std", "bias", "quality", "calibration")
    ]
    return (
        np.array([number for _, number in numbers(batches)]).tobytes(),
        *(np.concatenate([getattr(b, name) for b in batches]).tobytes() for name in ("ticks", "rate", "flags")),
        *spread,
    )
