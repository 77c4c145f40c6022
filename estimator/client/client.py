"""Subscriber session on a ward's bus: message streams, current state, and commands to the estimator."""

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
    OrientationBatch,
    Owned,
    Placement,
    SampleBatch,
    Status,
    WindowBatch,
)
from bridge.wire.refusal import Refusal
from estimator.client.connection import connected, denied
from estimator.client.decoder import Decoder
from estimator.client.reorder_buffer import BOOTS, HANDOVER_S, WAIT_S, Miss
from estimator.client.stream import Corrected, Stream

#: one device, several devices, or None for every device of the ward
Devices = str | Iterable[str] | None
#: unread messages kept for a slow program: half a minute of a hundred devices
QUEUE = 65536
#: shortest search before `alive` reports that nobody is there, s
NONE_S = 2.0
T = TypeVar("T")


class Client:
    """Subscriber session on the bus of one ward; open one client for each ward.

    Raises BusError when no router answers. Routers reject denied subscriptions silently. `denied` and the log state
    what this client's certificate does not permit.
    """

    def __init__(self, endpoints: str | Sequence[str] = (LOCAL,), *, ward: str, bus: Bus | None = None) -> None:
        endpoints = (endpoints,) if isinstance(endpoints, str) else endpoints
        self.ward = keys.check_id(ward, "ward")
        self._own = bus is None
        self._bus: Bus = connected(endpoints) if bus is None else bus
        #: reasons why no message may arrive although a router is connected; empty if no fault is known
        self.denied = denied(self._bus, endpoints, ward) if self._own else ()

    @property
    def connected(self) -> bool:
        """Whether a router is connected now. While disconnected no message arrives, and the client retries for ever."""
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
        """Stream of corrected batches, each sample exactly once and in order. With `history` the last seconds come first.

        Iteration ends after idle_s seconds without a batch, or when the stream is closed. Missing samples are waited
        for wait_s seconds, or at least 3 s where another estimator publishes the samples after the hole. Then the hole
        is given up, counted in `missing` and reported to on_miss. Beyond `queue` unread messages the oldest are
        dropped. If the named devices send nothing for five seconds, the log says so, unless `quiet`.
        """
        device = device if device is None or isinstance(device, str) else tuple(device)
        named = device if isinstance(device, str) else ", ".join(device or ())
        nothing = (
            f"no corrected rates of {named} in ward {self.ward} yet:"
            f" `truerate devices --ward {self.ward}` lists the ward's devices"
        )
        subscription = self._subscribe("corrected", device, history=history, queue=queue)
        return Corrected(subscription, idle_s, wait_s, on_miss, nothing if named and not quiet else "")

    def rates(self, device: Devices = None) -> Stream[codec.Rates]:
        """Stream of live corrected rates without history, reordering or waiting, for a program that shows many devices.

        A sample may arrive twice when two estimators publish it.
        """
        return self._stream("corrected", codec.decode_rates, device, history=False)

    def revisions(
        self, device: Devices = None, *, history: bool = True, idle_s: float | None = None, queue: int = QUEUE
    ) -> Stream[BiasRevision]:
        """Stream of bias revisions: better estimates of the past bias. With `history` the last few come first.

        Iteration ends as for `corrected`. `revised` applies a revision to a batch.
        """
        return self._stream("revision", codec.decode_revision, device, idle_s, history=history, queue=queue)

    def orientation(
        self, device: Devices = None, *, idle_s: float | None = None, queue: int = QUEUE
    ) -> Stream[OrientationBatch]:
        """Stream of attitudes: quaternions sensor to earth, tilt and heading with standard deviations (docs/orientation.md).

        Made only while somebody subscribes, from a second later on, without history: a message follows each corrected batch.
        Iteration ends as for `corrected`.
        """
        return self._stream("orientation", codec.decode_orientation, device, idle_s, history=False, queue=queue)

    def windows(
        self, device: Devices = None, *, idle_s: float | None = None, queue: int = QUEUE
    ) -> Stream[WindowBatch]:
        """Stream of window statistics at 10 Hz, for readings and corrected rates.

        Each window has mean, standard deviation, minimum and maximum. For programs that show many devices. Messages
        arrive about once a second, without history, and are made only while somebody subscribes. Iteration ends as for
        `corrected`.
        """
        return self._stream("@windowed", codec.decode_windows, device, idle_s, history=False, queue=queue)

    def raw(self, device: Devices = None, *, history: bool = True, queue: int = QUEUE) -> Stream[SampleBatch]:
        """Stream of raw readings as the bridges publish them. With `history` the last seconds come first."""
        return self._stream("raw", codec.decode_samples, device, history=history, queue=queue)

    def follow(self, device: Devices = None) -> Stream[Status]:
        """Stream of device statuses; the latest known status comes first.

        Statuses of an estimator that has lost the device are left out.
        """
        return self._stream("status", codec.decode_status, device, wanted=_current())

    def follow_infos(self, device: Devices = None) -> Stream[DeviceInfo]:
        """Stream of device infos from every bridge that lists a device; the latest known info comes first."""
        return self._stream("info", codec.decode_info, device)

    def follow_calibrations(self, device: Devices = None) -> Stream[Calibration]:
        """Stream of calibrations, accepted or rejected; the last few come first."""
        return self._stream("calibration", codec.decode_calibration, device)

    def follow_notes(self, device: Devices = None) -> Stream[Note]:
        """Stream of notes that people attach to devices; the last few come first."""
        return self._stream("note", codec.decode_note, device)

    def follow_owned(self) -> Stream[Owned]:
        """Stream of what estimators say of themselves, with their own alerts."""
        return self._stream("owned", codec.decode_owned, history=False)

    def statuses(self, wait_s: float = 1.5, device: str | None = None) -> dict[str, Status]:
        """Latest status by device id, of all devices or of one, from the messages of wait_s seconds.

        Every estimator publishes each status once a second.
        """
        return {status.device: status for status in self.follow(device).collect(wait_s)}

    def calibrations(self, device: str | None = None, wait_s: float = 0.5) -> list[Calibration]:
        """Recently published calibrations, accepted or rejected."""
        return self.follow_calibrations(device).collect(wait_s)

    def owned(self, wait_s: float = 1.3) -> list[Owned]:
        """Ownership messages of estimators received within wait_s. Each estimator sends one at least once a second."""
        return self._stream("owned", codec.decode_owned).collect(wait_s)

    def alive(self, what: str, wait_s: float = 0.3) -> list[str]:
        """Sorted ids of the live processes of one kind: `what` is `bridge` or `estimator`.

        An empty list is returned only after a search of at least NONE_S seconds.
        """
        found: dict[str, bool] = {}
        watch = self.watch_alive(what, found.__setitem__)
        time.sleep(wait_s)
        deadline = time.monotonic() + NONE_S
        while not any(found.copy().values()) and time.monotonic() < deadline:
            time.sleep(0.05)  # a busy machine answers late, and a false "nobody is there" alarms people
        watch.close()
        return sorted(name for name, there in found.copy().items() if there)

    def watch_alive(self, what: str, on_change: Callable[[str, bool], None]) -> Declared:
        """Call on_change(id, alive) for each live `bridge` or `estimator` and each change, on a thread of the bus."""

        def tell(key: str, alive: bool) -> None:  # noqa: FBT001 - the bus's contract
            if name := _id(key, what):
                on_change(name, alive)

        return self._bus.watch_alive(keys.pattern(self.ward, f"alive/{what}"), tell)

    def recalibrate(self, device: str, who: str, reason: str = "") -> CommandReply:
        """Request a new calibration of a device. Raises BusError when no estimator answers."""
        return self._command(device, "recalibrate", who, reason)

    def cancel(self, device: str, who: str, reason: str = "") -> CommandReply:
        """Cancel a running calibration; the previous one stays in force. Raises BusError when no estimator answers."""
        return self._command(device, "cancel", who, reason)

    def note(self, device: str, who: str, text: str) -> CommandReply:
        """Attach a text to this moment of a device, in the audit table and published for recordings."""
        return self._command(device, "note", who, text)

    def forget(self, device: str, who: str, reason: str = "", *, erase: bool = False) -> CommandReply:
        """Remove a device that sends no more from the ward. erase: also from the store, except its audit.

        Raises BusError if no estimator answers.
        """
        return self._command(device, "erase" if erase else "forget", who, reason)

    def zero_heading(self, device: str, who: str, reason: str = "") -> CommandReply:
        """Make a device's present heading zero. Raises BusError when no estimator answers."""
        return self._command(device, "zero-heading", who, reason)

    def place(self, device: str, who: str, placement: Placement) -> CommandReply:
        """Say where and by whom a device is worn from now on; an empty placement ends it. Raises as `recalibrate`."""
        return self._command(device, "place", who, "", placement)

    def acknowledge(self, subject: str, who: str, kind: str = "") -> CommandReply:
        """Say that a person has seen an alert, or with "" all alerts, of a device or an estimator. Raises as `recalibrate`."""
        return self._command(subject, "acknowledge", who, kind)

    def close(self) -> None:
        """Close the session; a bus that was passed in stays open."""
        if self._own:
            self._bus.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _command(
        self, device: str, verb: str, who: str, reason: str, placement: Placement | None = None
    ) -> CommandReply:
        key = keys.build(self.ward, "rpc", device=device, verb=verb)
        payload = codec.encode_command(Command(uuid.uuid4().hex, who, reason, placement))
        try:
            return codec.decode_reply(self._bus.ask(key, payload))
        except BusError:
            if self.connected and not self.alive("estimator"):
                raise BusError(
                    f"no estimator answers in ward {self.ward}: name the right ward with --config WARD.toml or --ward"
                    " NAME, or start its estimator with `truerate estimator serve WARD.toml`"
                ) from None
            raise
        except Refusal as refusal:
            raise BusError(
                f"the estimator's answer to {verb} is invalid: {refusal}; use the same version of truerate on both sides"
            ) from refusal

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
            raise ValueError("the list of devices is empty: name devices, or give None for the whole ward")
        ids = [{} if one is None else {"device": one} for one in devices]
        patterns = [keys.pattern(self.ward, what, **of) for of in ids]
        return self._bus.subscribe(patterns, history=history, capacity=queue)


def _current() -> Callable[[Status], bool]:
    """Filter for statuses that drops former owners: a newer epoch was heard in the last HANDOVER_S."""
    newest: dict[str, tuple[int, float]] = {}

    def current(status: Status) -> bool:
        epoch, heard_s = newest.get(status.device, (0, 0.0))
        now = time.monotonic()
        if status.epoch < epoch and now - heard_s < HANDOVER_S:
            return False
        newest.pop(status.device, None)
        newest[status.device] = status.epoch, now
        if len(newest) > BOOTS:  # the device heard longest ago leaves
            del newest[next(iter(newest))]
        return True

    return current


def _id(key: str, what: str) -> str:
    try:
        return keys.parse(key).ids[what]
    except Refusal:
        return ""
