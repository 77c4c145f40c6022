"""Client of a ward: message streams, current state, and commands to the estimator."""

import time
import uuid
from collections.abc import Callable, Iterable, Sequence
from typing import Self, TypeVar

from bridge.bus.contract import Bus, BusError, Declared, Subscription
from bridge.bus.zenoh_bus import ZenohBus
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
from estimator.client.connection import denied
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
    """Client of one ward: a session on its bus, which streams messages and sends commands to the estimator.

    endpoints: addresses of routers, such as `tcp/10.0.0.5:7447`. ward: name of the ward. bus: an open session to use
    instead of connecting to endpoints.
    `denied` and the log state what this client's certificate does not permit, because routers reject subscriptions
    silently.
    Raises BusError if no router answers, and Refusal if `ward` is not a valid id. Its methods raise Refusal for an
    invalid device id.
    """

    def __init__(self, endpoints: str | Sequence[str] = (LOCAL,), *, ward: str, bus: Bus | None = None) -> None:
        endpoints = (endpoints,) if isinstance(endpoints, str) else endpoints
        self.ward = keys.check_id(ward, "ward")
        self._own = bus is None
        self._bus: Bus = ZenohBus(endpoints) if bus is None else bus
        #: reasons why no message may arrive although a router is connected; empty if no fault is known
        self.denied = denied(self._bus, endpoints, ward) if self._own else ()

    @property
    def connected(self) -> bool:
        """True if a router is connected now. Otherwise no message arrives, and the client keeps trying to connect."""
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
        """Return a stream of corrected batches: rates (n, 3), rad/s, sensor frame; each sample exactly once and in order.

        device: one device id, several ids, or None for every device of the ward. history: True first delivers cached
        batches of the last seconds.
        idle_s: iteration ends after this time without a batch, or when the stream is closed.
        wait_s: time to wait for missing samples. If the samples after a gap come from another estimator than those
        before it, the wait is at least 3 s.
        A gap that is not filled is counted in `missing` and reported to on_miss.
        queue: largest number of unread messages; beyond it, the oldest are dropped.
        quiet: False logs a warning if the named devices send nothing for five seconds.
        Raises ValueError for an empty list of devices, as every stream of this class does.
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
        """Return a stream of live corrected rates, for a program that shows many devices.

        Each message has a device id and rates (n, 3) float32, rad/s, sensor frame. There is no history, no reordering
        and no waiting. A sample may arrive twice if two estimators publish it. device: one id, several ids, or None for
        all.
        """
        return self._stream("corrected", codec.decode_rates, device, history=False)

    def revisions(
        self, device: Devices = None, *, history: bool = True, idle_s: float | None = None, queue: int = QUEUE
    ) -> Stream[BiasRevision]:
        """Return a stream of bias revisions: better estimates of the past bias, in rad/s.

        `revised` applies a revision to a batch. device: one id, several ids, or None for all. history: True delivers
        the last few revisions first. idle_s: iteration ends after this time without a revision, or when the stream is
        closed.
        queue: largest number of unread messages; beyond it, the oldest are dropped.
        """
        return self._stream("revision", codec.decode_revision, device, idle_s, history=history, queue=queue)

    def orientation(
        self, device: Devices = None, *, idle_s: float | None = None, queue: int = QUEUE
    ) -> Stream[OrientationBatch]:
        """Return a stream of attitudes of the corrected samples, sensor to earth axes with z up.

        Each message has unit quaternions (n, 4), scalar first, and for its last sample the covariance (3, 3), rad², of
        the attitude error as a small rotation about earth axes. See OrientationBatch for all fields.
        A message follows each corrected batch (docs/orientation.md). Attitudes are computed only while a program
        subscribes, starting about a second after the subscription; there is no history. device: one id, several ids, or
        None for all.
        idle_s: iteration ends after this time without a message, or when the stream is closed. queue: largest number of
        unread messages; beyond it, the oldest are dropped.
        """
        return self._stream("orientation", codec.decode_orientation, device, idle_s, history=False, queue=queue)

    def windows(
        self, device: Devices = None, *, idle_s: float | None = None, queue: int = QUEUE
    ) -> Stream[WindowBatch]:
        """Return a stream of statistics of gyro readings and of corrected rates, rad/s, in windows of 0.1 s.

        For programs that show many devices. Each window has mean, standard deviation, minimum and maximum. Messages
        arrive about once a second, without history, and are made only while a program subscribes. device: one id,
        several ids, or None for all.
        idle_s: iteration ends after this time without a message, or when the stream is closed. queue: largest number of
        unread messages; beyond it, the oldest are dropped.
        """
        return self._stream("@windowed", codec.decode_windows, device, idle_s, history=False, queue=queue)

    def raw(self, device: Devices = None, *, history: bool = True, queue: int = QUEUE) -> Stream[SampleBatch]:
        """Return a stream of raw readings as the bridges publish them, in SI units, sensor frame.

        Gyro in rad/s; accelerometer in m/s² and temperature in °C if the device has them. device: one id, several ids,
        or None for all. history: True first delivers cached readings of the last seconds. queue: largest number of
        unread messages; beyond it, the oldest are dropped.
        """
        return self._stream("raw", codec.decode_samples, device, history=history, queue=queue)

    def follow(self, device: Devices = None) -> Stream[Status]:
        """Return a stream of device statuses: state, quality, bias in rad/s, and sample counts.

        The latest status of each device is delivered first. If another estimator has taken over the device, statuses
        from the former estimator are left out. device: one id, several ids, or None for all.
        """
        return self._stream("status", codec.decode_status, device, wanted=_current())

    def follow_infos(self, device: Devices = None) -> Stream[DeviceInfo]:
        """Return a stream of device infos (identity, settings, sample counts) from every bridge that lists a device.

        The latest info of each device is delivered first. device: one id, several ids, or None for all.
        """
        return self._stream("info", codec.decode_info, device)

    def follow_calibrations(self, device: Devices = None) -> Stream[Calibration]:
        """Return a stream of calibrations, accepted or not; the last few of each device are delivered first.

        device: one id, several ids, or None for all.
        """
        return self._stream("calibration", codec.decode_calibration, device)

    def follow_notes(self, device: Devices = None) -> Stream[Note]:
        """Return a stream of notes, which people attach to a moment of a device; the last few are delivered first.

        device: one id, several ids, or None for all.
        """
        return self._stream("note", codec.decode_note, device)

    def follow_owned(self) -> Stream[Owned]:
        """Return a stream of Owned messages: the devices that each estimator processes, its load, and its own alerts.

        Each estimator sends one at least once a second. There is no history.
        """
        return self._stream("owned", codec.decode_owned, history=False)

    def statuses(self, wait_s: float = 1.5, device: str | None = None) -> dict[str, Status]:
        """Return the latest status by device id, after listening for wait_s seconds.

        Every estimator publishes each status once a second. device: id; None for all devices.
        """
        return {status.device: status for status in self.follow(device).collect(wait_s)}

    def calibrations(self, device: str | None = None, wait_s: float = 0.5) -> list[Calibration]:
        """Return the recent calibrations, accepted or not, after listening for wait_s seconds.

        device: id; None for all devices.
        """
        return self.follow_calibrations(device).collect(wait_s)

    def owned(self, wait_s: float = 1.3) -> list[Owned]:
        """Return Owned messages, the devices that each estimator processes, after listening for wait_s seconds.

        Each estimator sends one at least once a second.
        """
        return self._stream("owned", codec.decode_owned).collect(wait_s)

    def alive(self, what: str, wait_s: float = 0.3) -> list[str]:
        """Return the sorted ids of the live processes of one kind; empty if there is none.

        what: `bridge` or `estimator`. The search takes wait_s seconds, and up to NONE_S (2 s) more while no process
        is found.
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
        """Watch the live processes of one kind: call on_change(id, alive) for each one now, and for each change.

        what: `bridge` or `estimator`. on_change: called in a thread of the bus; `alive` is True if the process runs.
        Returns the handle of the watch; close the handle to end it.
        """

        def tell(key: str, alive: bool) -> None:  # noqa: FBT001 - the bus's contract
            if name := _id(key, what):
                on_change(name, alive)

        return self._bus.watch_alive(keys.pattern(self.ward, f"alive/{what}"), tell)

    def recalibrate(self, device: str, who: str, reason: str = "") -> CommandReply:
        """Request a new calibration of a device.

        who: name of the person or program that asks, for the audit table. reason: free text.
        Returns the estimator's reply: accepted or refused, with a message. Raises BusError if no estimator answers.
        """
        return self._command(device, "recalibrate", who, reason)

    def cancel(self, device: str, who: str, reason: str = "") -> CommandReply:
        """Cancel a running calibration of a device; the previous calibration stays in use.

        who: name of the person or program that asks, for the audit table. reason: free text.
        Returns the estimator's reply: accepted or refused, with a message. Raises BusError if no estimator answers.
        """
        return self._command(device, "cancel", who, reason)

    def note(self, device: str, who: str, text: str) -> CommandReply:
        """Attach a text to the present moment of a device; it is stored in the audit table and published for recordings.

        who: name of the person or program, for the audit table.
        Returns the estimator's reply, which refuses an empty text. Raises BusError if no estimator answers.
        """
        return self._command(device, "note", who, text)

    def forget(self, device: str, who: str, reason: str = "", *, erase: bool = False) -> CommandReply:
        """Remove a device from its ward, after the device has stopped sending.

        who: name of the person or program that asks, for the audit table. reason: free text.
        erase: True also deletes its entries in the store, except its rows in the audit table.
        Returns the estimator's reply, which refuses a device that still sends, or that the ward file lists as enrolled.
        Raises BusError if no estimator answers.
        """
        return self._command(device, "erase" if erase else "forget", who, reason)

    def zero_heading(self, device: str, who: str, reason: str = "") -> CommandReply:
        """Set a device's present heading to zero.

        who: name of the person or program that asks, for the audit table. reason: free text.
        Returns the estimator's reply: accepted or refused, with a message. Raises BusError if no estimator answers.
        """
        return self._command(device, "zero-heading", who, reason)

    def place(self, device: str, who: str, placement: Placement) -> CommandReply:
        """Set the placement of a device from now on: its place on a body, and the wearer.

        placement: an empty one ends the present one.
        who: name of the person or program, for the audit table.
        Returns the estimator's reply: accepted or refused, with a message. Raises BusError if no estimator answers.
        """
        return self._command(device, "place", who, "", placement)

    def acknowledge(self, subject: str, who: str, kind: str = "") -> CommandReply:
        """Acknowledge an alert: a person has seen it.

        subject: id of a device or an estimator. who: name of the person. kind: kind of alert, such as `lost` or
        `battery_low`; "" for all alerts of the subject.
        Returns the estimator's reply, which refuses if there is no such alert. Raises BusError if no estimator answers.
        """
        return self._command(subject, "acknowledge", who, kind)

    def close(self) -> None:
        """Close the bus session, which ends the streams; a session that was passed as `bus` stays open."""
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
    """Filter for statuses that drops those of former owners.

    A status is dropped if one with a newer epoch was heard of the same device in the last HANDOVER_S.
    """
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
