"""A subscriber's session on the bus of a ward: streams, what is known now, and commands."""

import time
import uuid
from collections.abc import Callable, Iterable, Sequence
from typing import Self, TypeVar

from bridge.bus.contract import Bus, BusError, Declared, Subscription
from bridge.config.schema import LOCAL
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
from estimator.client.connection import connected, denied
from estimator.client.decoder import Decoder
from estimator.client.reorder_buffer import HANDOVER_S, WAIT_S, Miss
from estimator.client.stream import Corrected, Stream

#: one device, a few, or (None) all of the ward
Devices = str | Iterable[str] | None
#: unread messages kept for a slow program: half a minute of a hundred devices
QUEUE = 65536
#: nobody is said to be there who may only be slow to show it, s
NONE_S = 2.0
T = TypeVar("T")


class Client:
    """One subscriber's session on the bus of a ward; of more wards, open one each. Raises BusError when no router answers.

    Routers deny silently: what ours does not let us do stands in `denied`, in words, and in the log.
    """

    def __init__(self, endpoints: str | Sequence[str] = (LOCAL,), *, ward: str, bus: Bus | None = None) -> None:
        endpoints = (endpoints,) if isinstance(endpoints, str) else endpoints
        self.ward = keys.check_id(ward, "ward")
        self._own = bus is None
        self._bus: Bus = connected(endpoints) if bus is None else bus
        #: why nothing may come although a router is there; empty where nothing is known to be wrong
        self.denied = denied(self._bus, endpoints, ward) if self._own else ()

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

        Iterating ends after idle_s seconds without a batch, or when the stream is closed. A hole is waited for wait_s seconds
        (3 s at least where another estimator goes on behind it), then given up, counted in `missing` and told to on_miss. Of
        more than `queue` unread messages the oldest are dropped. Where nothing comes of devices that were named the log says so
        after five seconds, unless `quiet`.
        """
        device = device if device is None or isinstance(device, str) else tuple(device)
        named = device if isinstance(device, str) else ", ".join(device or ())
        nothing = (
            f"nothing has come yet of {named} in ward {self.ward}; are the names right?"
            f" `truerate devices --ward {self.ward}` shows who is there"
        )
        subscription = self._subscribe("corrected", device, history=history, queue=queue)
        return Corrected(subscription, idle_s, wait_s, on_miss, nothing if named and not quiet else "")

    def rates(self, device: Devices = None) -> Stream[codec.Rates]:
        """How fast devices turn, as it comes from now on and nothing more: for a program that shows many of them.

        A sample may come twice where two estimators say it, and none is waited for.
        """
        return self._stream("corrected", codec.decode_rates, device, history=False)

    def revisions(
        self, device: Devices = None, *, history: bool = True, idle_s: float | None = None, queue: int = QUEUE
    ) -> Stream[BiasRevision]:
        """What the bias of the past was, as it becomes known; with history the last few come first.

        Iterating ends as that of `corrected` does. `revised` applies a revision to a batch.
        """
        return self._stream("revision", codec.decode_revision, device, idle_s, history=history, queue=queue)

    def windows(
        self, device: Devices = None, *, idle_s: float | None = None, queue: int = QUEUE
    ) -> Stream[WindowBatch]:
        """Mean, deviation, least and most of readings and corrected rates ten times a second: to show many devices.

        They come about once a second from now on, and are made only while somebody asks. Iterating ends as that of `corrected`.
        """
        return self._stream("@windowed", codec.decode_windows, device, idle_s, history=False, queue=queue)

    def raw(self, device: Devices = None, *, history: bool = True, queue: int = QUEUE) -> Stream[SampleBatch]:
        """What devices say, as their bridges publish it; with history the last seconds come first."""
        return self._stream("raw", codec.decode_samples, device, history=history, queue=queue)

    def follow(self, device: Devices = None) -> Stream[Status]:
        """Statuses as they come; the latest known comes first. Those of an estimator that has lost the device are left out."""
        return self._stream("status", codec.decode_status, device, wanted=_current())

    def follow_infos(self, device: Devices = None) -> Stream[DeviceInfo]:
        """Device infos as they come, of every bridge that lists a device; the latest known comes first."""
        return self._stream("info", codec.decode_info, device)

    def follow_calibrations(self, device: Devices = None) -> Stream[Calibration]:
        """Calibrations as they come, accepted or not; the last few come first."""
        return self._stream("calibration", codec.decode_calibration, device)

    def follow_notes(self, device: Devices = None) -> Stream[Note]:
        """Notes as they are taken down; the last few come first."""
        return self._stream("note", codec.decode_note, device)

    def statuses(self, wait_s: float = 1.5, device: str | None = None) -> dict[str, Status]:
        """The latest status of every device, or of one: what comes within wait_s (all say it once a second)."""
        return {status.device: status for status in self.follow(device).collect(wait_s)}

    def calibrations(self, device: str | None = None, wait_s: float = 0.5) -> list[Calibration]:
        """Calibrations the estimator has published lately, accepted or not."""
        return self.follow_calibrations(device).collect(wait_s)

    def owned(self, wait_s: float = 1.3) -> list[Owned]:
        """What estimators say to have, as it came within wait_s (all say it once a second, or more often)."""
        return self._stream("owned", codec.decode_owned).collect(wait_s)

    def alive(self, what: str, wait_s: float = 0.3) -> list[str]:
        """The ids of every `bridge` or `estimator` there is now; that there is none is said after a second look of NONE_S."""
        found: dict[str, bool] = {}
        watch = self.watch_alive(what, found.__setitem__)
        time.sleep(wait_s)
        deadline = time.monotonic() + NONE_S
        while not any(found.copy().values()) and time.monotonic() < deadline:
            time.sleep(0.05)  # on a busy machine the answer takes its time, and that nobody is there alarms people
        watch.close()
        return sorted(name for name, there in found.copy().items() if there)

    def watch_alive(self, what: str, on_change: Callable[[str, bool], None]) -> Declared:
        """Tell of every `bridge` or `estimator` there is, on_change(id, alive), and of each change; on a thread of the bus."""

        def tell(key: str, alive: bool) -> None:  # noqa: FBT001 - the bus's contract
            if name := _id(key, what):
                on_change(name, alive)

        return self._bus.watch_alive(keys.pattern(self.ward, f"alive/{what}"), tell)

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

    def _stream(
        self,
        what: str,
        decode: Callable[[str, bytes], T],
        device: Devices = None,
        idle_s: float | None = None,
        *,
        history: bool = True,
        queue: int = QUEUE,
        wanted: Callable[[T], bool] = lambda _: True,
    ) -> Stream[T]:
        return Stream(
            self._subscribe(what, device, history=history, queue=queue), Decoder(what, decode), idle_s, wanted
        )

    def _subscribe(self, what: str, device: Devices, *, history: bool, queue: int) -> Subscription:
        devices = [device] if device is None or isinstance(device, str) else dict.fromkeys(device)
        if not devices:
            raise ValueError("an empty list of devices; give one or more, or None for all of the ward")
        ids = [{} if one is None else {"device": one} for one in devices]
        patterns = [keys.pattern(self.ward, what, **of) for of in ids]
        return self._bus.subscribe(patterns, history=history, capacity=queue)


def _current() -> Callable[[Status], bool]:
    """Whether a status is from the estimator that has the device now: none of a newer epoch came lately."""
    newest: dict[str, tuple[int, float]] = {}

    def current(status: Status) -> bool:
        epoch, heard_s = newest.get(status.device, (0, 0.0))
        now = time.monotonic()
        if status.epoch < epoch and now - heard_s < HANDOVER_S:
            return False
        newest[status.device] = status.epoch, now
        return True

    return current


def _id(key: str, what: str) -> str:
    try:
        return keys.parse(key).ids[what]
    except Refusal:
        return ""
