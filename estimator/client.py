"""The Python way to subscribe: corrected rates, revisions, status and calibrations of a ward, and commands to its estimator.

from estimator.client import Client

with Client(ward="demo") as ward:
for batch in ward.corrected():
print(batch.device, batch.quality.name, batch.rate[-1], "±", batch.rate_std[-1])
"""

import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from typing import Generic, Self, TypeVar

from bridge.bus.contract import Bus, BusError, Message, Subscription
from bridge.bus.zenoh_bus import ZenohBus
from bridge.config import LOCAL
from bridge.wire import codec, keys
from bridge.wire.messages import BiasRevision, Calibration, Command, CommandReply, CorrectedBatch, DeviceInfo, Status
from bridge.wire.refusal import Refusal
from estimator.door import Door

T = TypeVar("T")
_REMEMBERED_BOOTS = 10_000
#: an estimator follows a number that went back only after some seconds; clock fits differ by less
_ANEW_NS = 1_000_000_000


class Client:
    """One subscriber's session on the bus of a ward; raises BusError when there is no router."""

    def __init__(self, endpoints: Sequence[str] = (LOCAL,), *, ward: str, bus: Bus | None = None) -> None:
        self.ward = keys.check_id(ward, "ward")
        self._own = bus is None
        self._bus: Bus = ZenohBus(endpoints) if bus is None else bus

    def corrected(self, device: str | None = None, *, history: bool = True, idle_s: float | None = None) -> "Corrected":
        """Corrected batches of one device or of all, each sample exactly once; with history the last seconds come first.

        Iterating ends after idle_s seconds without a batch, or when it is closed.
        """
        return Corrected(self._bus.subscribe(self._pattern("corrected", device), history=history), idle_s)

    def revisions(
        self, device: str | None = None, *, history: bool = True, idle_s: float | None = None
    ) -> "Stream[BiasRevision]":
        """What the bias of the past was, of one device or of all, as it becomes known; with history the last few come first.

        Iterating ends as that of `corrected` does. See estimator.revision for what to do with one.
        """
        subscription = self._bus.subscribe(self._pattern("revision", device), history=history)
        return Stream(subscription, Door("revision", codec.decode_revision), idle_s)

    def statuses(self, wait_s: float = 1.5, device: str | None = None) -> dict[str, Status]:
        """The latest status of every device, or of one: what comes within wait_s (all say it once a second)."""
        return {s.device: s for s in self._collect("status", codec.decode_status, wait_s, device)}

    def infos(self, wait_s: float = 1.5) -> dict[str, DeviceInfo]:
        """The latest device info of every device; of several bridges that list it, from one that hears it."""
        found: dict[str, DeviceInfo] = {}
        for info in self._collect("info", codec.decode_info, wait_s):
            if info.boot or info.device not in found or found[info.device].bridge == info.bridge:
                found[info.device] = info
        return found

    def alive(self, what: str, wait_s: float = 0.3) -> list[str]:
        """The ids of every `bridge` or `estimator` there is now."""
        found: dict[str, bool] = {}
        watch = self._bus.watch_alive(keys.pattern(self.ward, f"alive/{what}"), found.__setitem__)
        try:
            time.sleep(wait_s)
        finally:
            watch.close()
        return sorted(_id(key, what) for key, there in found.copy().items() if there and _id(key, what))

    def follow(self, device: str | None = None) -> "Statuses":
        """Statuses as they come, of one device or of all; the latest known comes first."""
        return Statuses(self._bus.subscribe(self._pattern("status", device), history=True))

    def calibrations(self, device: str | None = None, wait_s: float = 0.5) -> list[Calibration]:
        """Calibrations the estimator has published lately, accepted or not."""
        return self._collect("calibration", codec.decode_calibration, wait_s, device)

    def recalibrate(self, device: str, who: str, reason: str = "") -> CommandReply:
        """Ask for a new calibration; raises BusError when no estimator answers."""
        return self._command(device, "recalibrate", who, reason)

    def cancel(self, device: str, who: str, reason: str = "") -> CommandReply:
        """Stop a calibration under way; the old one stays."""
        return self._command(device, "cancel", who, reason)

    def note(self, device: str, who: str, text: str) -> CommandReply:
        """Mark this moment of a device: kept in the audit, and published, so that it is in recordings."""
        return self._command(device, "note", who, text)

    def close(self) -> None:
        """End the session."""
        if self._own:
            self._bus.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _command(self, device: str, verb: str, who: str, reason: str) -> CommandReply:
        key = keys.build(self.ward, "rpc", device=device, verb=verb)
        payload = codec.encode_command(Command(uuid.uuid4().hex, who, reason))
        try:
            return codec.decode_reply(self._bus.ask(key, payload))
        except Refusal as refusal:
            raise BusError(f"the answer to {verb} was not understood: {refusal}") from refusal

    def _pattern(self, what: str, device: str | None) -> str:
        return keys.pattern(self.ward, what, **({} if device is None else {"device": device}))

    def _collect(
        self, what: str, decode: Callable[[str, bytes], T], wait_s: float, device: str | None = None
    ) -> list[T]:
        door = Door(what, decode)
        subscription = self._bus.subscribe(self._pattern(what, device), history=True)
        try:
            deadline, found = time.monotonic() + wait_s, []
            while (left := deadline - time.monotonic()) > 0:
                found += [
                    taken for message in subscription.drain(4096, left) if (taken := door.take(message)) is not None
                ]
            return found
        finally:
            subscription.close()


def _id(key: str, what: str) -> str:
    try:
        return keys.parse(key).ids[what]
    except Refusal:
        return ""


class Stream(Generic[T]):
    """An iterator over messages of one kind. `missed` messages were lost on the way."""

    def __init__(self, subscription: Subscription, door: Door[T], idle_s: float | None) -> None:
        self._subscription, self._door, self._idle_s = subscription, door, idle_s

    @property
    def refused(self) -> dict[str, int]:
        """Messages that were not understood, by reason."""
        return self._door.refused.as_dict()

    @property
    def missed(self) -> int:
        """Messages known to be lost."""
        return self._subscription.missed

    def receive(self, timeout_s: float) -> T | None:
        """The next message with something new, or None when none came in time."""
        message = self._subscription.receive(timeout_s)
        while message is not None:
            if (fresh := self._take(message)) is not None:
                return fresh
            message = self._subscription.receive(0.0)
        return None

    def __iter__(self) -> Iterator[T]:
        while True:
            message = self.receive(1.0 if self._idle_s is None else self._idle_s)
            if message is not None:
                yield message
            elif self._idle_s is not None or self._subscription.closed:
                return

    def close(self) -> None:
        """Stop receiving."""
        self._subscription.close()

    def _take(self, message: Message) -> T | None:
        return self._door.take(message)


class Corrected(Stream[CorrectedBatch]):
    """An iterator over corrected batches; `repeated` samples were left out."""

    def __init__(self, subscription: Subscription, idle_s: float | None) -> None:
        super().__init__(subscription, Door("corrected", codec.decode_corrected), idle_s)
        self._known: dict[tuple[str, int], tuple[int, int]] = {}  # next sequence number, time of the last batch
        self.repeated = 0

    def _take(self, message: Message) -> CorrectedBatch | None:
        batch = super()._take(message)
        return None if batch is None else self._new_part(batch)

    def _new_part(self, batch: CorrectedBatch) -> CorrectedBatch | None:
        # After a restart an estimator corrects the last seconds again. Low numbers at a later time are no repeats: the
        # device was started anew under the same boot number.
        which, start_ns = (batch.device, batch.boot), batch.start_time_ns
        following, last_ns = self._known.pop(which, (batch.sequence, start_ns))
        if batch.sequence + len(batch) <= following and start_ns > last_ns + _ANEW_NS:
            following = batch.sequence
            last_ns = start_ns
        self._known[which] = max(following, batch.sequence + len(batch)), max(last_ns, start_ns)
        while len(self._known) > _REMEMBERED_BOOTS:
            del self._known[next(iter(self._known))]
        known = following - batch.sequence
        if known <= 0:
            return batch
        self.repeated += min(known, len(batch))
        return batch.after(known) if known < len(batch) else None


class Statuses:
    """Statuses as they come."""

    def __init__(self, subscription: Subscription) -> None:
        self._subscription = subscription
        self._door = Door("status", codec.decode_status)

    def drain(self, timeout_s: float = 0.0) -> list[Status]:
        """What has come, waiting at most timeout_s for the first."""
        messages = self._subscription.drain(4096, timeout_s)
        return [status for message in messages if (status := self._door.take(message)) is not None]

    def latest(self) -> Status | None:
        """The last of what has come since the last call, or None."""
        return next(reversed(self.drain()), None)

    def close(self) -> None:
        """Stop receiving."""
        self._subscription.close()
