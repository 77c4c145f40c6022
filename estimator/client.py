"""The Python way to subscribe: corrected rates, revisions, status and calibrations of a ward, and commands to its estimator.

from estimator.client import Client

    with Client(ward="demo") as ward:
        for batch in ward.corrected():  # or `async for`
            print(batch.device, batch.quality.name, batch.rate[-1], "std", batch.rate_std[-1])
"""

import logging
import threading
import time
import uuid
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Self, TypeVar

from bridge.bus.contract import Bus, BusError, Declared, Subscription
from bridge.bus.routers import Routers
from bridge.bus.self_test import self_test
from bridge.bus.zenoh_bus import ZenohBus
from bridge.config import LOCAL
from bridge.pki.member import Role
from bridge.wire import codec, keys
from bridge.wire.messages import (
    BiasRevision,
    Calibration,
    Command,
    CommandReply,
    DeviceInfo,
    Note,
    Owned,
    SampleBatch,
    Status,
    WindowBatch,
)
from bridge.wire.refusal import Refusal
from estimator.door import Door
from estimator.fence import Fence
from estimator.once import WAIT_S, Miss, OnceKnobs
from estimator.streams import Corrected, Stream

__all__ = ["BusError", "Client", "Corrected", "Miss", "Stream"]

#: one device, a few, or (None) all of the ward
Devices = str | Iterable[str] | None
#: unread messages kept for a slow program: half a minute of a hundred devices
QUEUE = 65536
#: a router that does not answer for so long is said to be looked for, s
LOOKED_S = 1.0
#: nobody is said to be there who may only be slow to show it, s
NONE_S = 2.0

#: whose certificates let them hear what a ward says
SUBSCRIBERS = (Role.VIEWER, Role.COMMANDER, Role.RECORDER)

log = logging.getLogger(__name__)
T = TypeVar("T")


class Client:
    """One subscriber's session on the bus of a ward; of more wards, open one each. Raises BusError when no router answers.

    Routers deny silently: what ours does not let us do stands in `denied`, in words, and in the log.
    """

    def __init__(self, endpoints: str | Sequence[str] = (LOCAL,), *, ward: str, bus: Bus | None = None) -> None:
        if isinstance(endpoints, str):
            endpoints = (endpoints,)
        self.ward = keys.check_id(ward, "ward")
        self._own = bus is None
        self._bus: Bus = _found(endpoints) if bus is None else bus
        #: why nothing may come although a router is there; empty where nothing is known to be wrong
        self.denied = _denied(self._bus, Routers.of(endpoints), ward) if bus is None else ()
        for words in self.denied:
            log.error("%s", words)

    @property
    def connected(self) -> bool:
        """Whether a router is there now. While none is, nothing comes; it is looked for again for ever."""
        return self._bus.connected

    def corrected(
        self,
        device: Devices = None,
        *,
        history: bool = True,
        idle_s: float | None = None,
        wait_s: float = WAIT_S,
        on_miss: Callable[[Miss], None] | None = None,
        queue: int = QUEUE,
        quiet: bool = False,
    ) -> Corrected:
        """Corrected batches: each sample exactly once and in order; with history the last seconds come first.

        Iterating ends after idle_s seconds without a batch, or when it is closed. A hole is waited for wait_s seconds (3 s at
        least where another estimator goes on behind it), then given up, counted in `missing` and told to on_miss. Of more than
        `queue` unread messages the oldest are dropped. Where nothing comes of devices that were named the log says so after
        five seconds, unless `quiet`.
        """
        device = device if device is None or isinstance(device, str) else tuple(device)
        subscription = self._subscribe("corrected", device, history=history, queue=queue)
        nothing = "" if quiet or device is None else self._nothing_of(device)
        return Corrected(
            subscription, Door("corrected", codec.decode_corrected), idle_s, OnceKnobs.patient(wait_s), on_miss, nothing
        )

    def rates(self, device: Devices = None) -> Stream[codec.Rates]:
        """How fast devices turn, as it comes from now on and nothing more: for who looks at many of them.

        A sample may come twice where two estimators say it, and none is waited for.
        """
        return Stream(self._subscribe("corrected", device, history=False), Door("corrected", codec.decode_rates))

    def revisions(
        self, device: Devices = None, *, history: bool = True, idle_s: float | None = None, queue: int = QUEUE
    ) -> Stream[BiasRevision]:
        """What the bias of the past was, as it becomes known; with history the last few come first.

        Iterating ends as that of `corrected` does. See estimator.revision for what to do with one.
        """
        subscription = self._subscribe("revision", device, history=history, queue=queue)
        return Stream(subscription, Door("revision", codec.decode_revision), idle_s)

    def windows(
        self, device: Devices = None, *, idle_s: float | None = None, queue: int = QUEUE
    ) -> Stream[WindowBatch]:
        """For who looks at many devices: mean, deviation, least and most of readings and corrected rates, ten times a second.

        They come about once a second from now on, and are made only while somebody asks. Iterating ends as that of `corrected`.
        """
        subscription = self._subscribe("@windowed", device, history=False, queue=queue)
        return Stream(subscription, Door("windows", codec.decode_windows), idle_s)

    def raw(self, device: Devices = None, *, history: bool = True, queue: int = QUEUE) -> Stream[SampleBatch]:
        """What devices say, as their bridges publish it; with history the last seconds come first."""
        subscription = self._subscribe("raw", device, history=history, queue=queue)
        return Stream(subscription, Door("sample", codec.decode_samples))

    def statuses(self, wait_s: float = 1.5, device: str | None = None) -> dict[str, Status]:
        """The latest status of every device, or of one: what comes within wait_s (all say it once a second)."""
        current = _current()
        return {s.device: s for s in self._collect("status", codec.decode_status, wait_s, device) if current(s)}

    def infos(self, wait_s: float = 1.5, owners: Mapping[str, str] | None = None) -> dict[str, DeviceInfo]:
        """The latest device info of every device; of several bridges that list it, from one that hears it.

        owners: whose samples of a device are taken (`bridge` of its status); there that bridge has the word.
        """
        found: dict[str, DeviceInfo] = {}
        for info in self._collect("info", codec.decode_info, wait_s):
            known = found.get(info.device)
            owner = (owners or {}).get(info.device)
            if known is None or info.bridge in (owner, known.bridge) or (info.boot and known.bridge != owner):
                found[info.device] = info
        return found

    def alive(self, what: str, wait_s: float = 0.3) -> list[str]:
        """The ids of every `bridge` or `estimator` there is now; that there is none is said after a second look of NONE_S."""
        found: dict[str, bool] = {}
        watch = self._bus.watch_alive(keys.pattern(self.ward, f"alive/{what}"), found.__setitem__)
        try:
            time.sleep(wait_s)
            deadline = time.monotonic() + NONE_S
            while not any(found.copy().values()) and time.monotonic() < deadline:
                time.sleep(0.05)  # on a busy machine the answer takes its time, and that nobody is there alarms people
        finally:
            watch.close()
        return sorted(_id(key, what) for key, there in found.copy().items() if there and _id(key, what))

    def owned(self, wait_s: float = 1.3) -> list[Owned]:
        """What estimators say to have, as it came within wait_s (all say it once a second, or more often)."""
        return self._collect("owned", codec.decode_owned, wait_s)

    def follow(self, device: Devices = None) -> Stream[Status]:
        """Statuses as they come; the latest known comes first. Those of an estimator whose device it is no more are left out."""
        return Stream(self._subscribe("status", device), Door("status", codec.decode_status), None, _current())

    def follow_infos(self, device: str | None = None) -> Stream[DeviceInfo]:
        """Device infos as they come, of every bridge that lists a device; the latest known comes first."""
        return Stream(self._subscribe("info", device), Door("info", codec.decode_info))

    def follow_calibrations(self, device: Devices = None) -> Stream[Calibration]:
        """Calibrations as they come, accepted or not; the last few come first."""
        return Stream(self._subscribe("calibration", device), Door("calibration", codec.decode_calibration))

    def follow_notes(self, device: Devices = None) -> Stream[Note]:
        """Notes as they are taken down; the last few come first."""
        return Stream(self._subscribe("note", device), Door("note", codec.decode_note))

    def watch_alive(self, what: str, on_change: Callable[[str, bool], None]) -> Declared:
        """Tell of every `bridge` or `estimator` there is, on_change(id, alive), and of each change; on a thread of the bus."""

        def tell(key: str, alive: bool) -> None:  # noqa: FBT001 - the bus's contract
            if name := _id(key, what):
                on_change(name, alive)

        return self._bus.watch_alive(keys.pattern(self.ward, f"alive/{what}"), tell)

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
        except BusError:
            if self.connected and not self.alive("estimator"):
                raise BusError(
                    f"no estimator answers in ward {self.ward}; is one running, and is the ward's name right?"
                ) from None
            raise
        except Refusal as refusal:
            raise BusError(f"the answer to {verb} was not understood: {refusal}") from refusal

    def _subscribe(self, what: str, device: Devices, *, history: bool = True, queue: int = QUEUE) -> Subscription:
        if device is None or isinstance(device, str):
            return self._bus.subscribe(self._pattern(what, device), history=history, capacity=queue)
        patterns = [self._pattern(what, one) for one in dict.fromkeys(device)]
        if not patterns:
            raise ValueError("an empty list of devices; give one or more, or None for all of the ward")
        return self._bus.subscribe(patterns, history=history, capacity=queue)

    def _nothing_of(self, device: str | Iterable[str]) -> str:
        names = device if isinstance(device, str) else ", ".join(device)
        ask = f"`truerate devices --ward {self.ward}`"
        return f"nothing has come yet of {names} in ward {self.ward}; are the names right? {ask} shows who is there"

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


def _found(endpoints: Sequence[str]) -> ZenohBus:
    """A session with a router; who has to wait for one is told so."""
    told = threading.Timer(LOOKED_S, log.warning, ("looking for a router at %s", ", ".join(endpoints)))
    told.daemon = True
    told.start()
    try:
        return ZenohBus(endpoints)
    finally:
        told.cancel()


def _denied(bus: Bus, routers: Routers, ward: str) -> tuple[str, ...]:
    if routers.identity is None:
        return ()
    for words in routers.soon():
        log.warning("%s", words)
    from bridge.pki.identity import member_of  # noqa: PLC0415 - only who has certificates waits until they can be read

    member = member_of(routers.identity)
    if member.role not in SUBSCRIBERS:
        fit = ", ".join(role.value for role in SUBSCRIBERS)
        return (
            f"the certificate is for {member.label}, which hears little or nothing; who subscribes is one of {fit}",
        )
    return tuple(self_test(bus, routers, ward))


def _current() -> Callable[[Status], bool]:
    """Whether a status is from the estimator that has the device now."""
    fence = Fence()
    return lambda status: fence.admits(status.device, status.epoch, time.monotonic())


def _id(key: str, what: str) -> str:
    try:
        return keys.parse(key).ids[what]
    except Refusal:
        return ""
