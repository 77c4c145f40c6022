"""Shows devices of a ward as x-IMU3s, each on a UDP port of its own."""

import contextlib
import logging
import socket
import threading
import time
from dataclasses import dataclass

from bridge.bus.contract import Bus, BusError, Message, Subscription
from bridge.reasons.catalogue import in_words
from bridge.virtual_ximu3.device import VirtualXimu3
from bridge.virtual_ximu3.ports import Address, Port, local
from bridge.wire import codec, keys
from bridge.wire.refusal import Refusal, Tally

_TURN_S = 0.02
_AT_ONCE = 4096
_ANNOUNCE_EVERY_S = 1.0
_PATIENCE_S = 2.0
MOST_DEVICES = 64
_MISSING = "no %s rates of %s in ward %s yet: `truerate devices` tells whether bridge and estimator run; --raw needs no estimator"

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Wanted:
    """What to show and where.

    devices: empty for all devices heard. to: address of the first device; each further device has the next port.
    announce: host or broadcast address to announce the devices to; None for no announcement.
    """

    ward: str
    to: Address
    devices: tuple[str, ...] = ()
    corrected: bool = True
    announce: Address | None = None


class Show:
    """Shows devices as x-IMU3s. `turn` does all due work and waits briefly at most; use from one thread."""

    def __init__(self, bus: Bus, wanted: Wanted) -> None:
        self.refused = Tally()
        self._wanted = wanted
        self._ports: dict[str, Port | None] = {}  # None: no free port
        self._bridges: dict[str, str] = {}  # the bridge first heard, for each device
        self._shown: set[str] = set()  # devices whose rates were passed on
        self._patient_until_s = time.monotonic() + _PATIENCE_S
        self._announced_s = float("-inf")
        self._announce_to = wanted.announce and wanted.announce.resolved()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self._subscriptions: list[Subscription] = []
        try:
            # Raw and info before corrected: accelerations and names must arrive first.
            for what in ("raw", "info", *(("corrected",) if wanted.corrected else ())):
                self._subscriptions.append(bus.subscribe(keys.pattern(wanted.ward, what), history=what == "info"))
            for device in wanted.devices:
                self._add(device)
        except (OSError, BusError):
            self.close()
            raise

    def turn(self) -> None:
        """Pass on received messages, answer commands, announce devices."""
        *others, last = self._subscriptions
        waited = last.drain(_AT_ONCE, _TURN_S)
        for messages in (*(subscription.drain(_AT_ONCE, 0.0) for subscription in others), waited):
            for message in messages:
                try:
                    self._take(message)
                except Refusal as refusal:
                    self.refused.add(refusal.reason)
        for port in filter(None, self._ports.values()):
            port.serve()
        self._announce()
        if time.monotonic() > self._patient_until_s:
            self._patient_until_s = float("inf")
            kind = "corrected" if self._wanted.corrected else "raw"
            expected = self._wanted.devices or tuple(self._ports) or ("any device",)
            if missing := [device for device in expected if device not in self._shown]:
                _log.warning(_MISSING, kind, ", ".join(missing), self._wanted.ward)

    @property
    def over(self) -> bool:
        """Whether the bus was closed."""
        return self._subscriptions[-1].closed

    def close(self) -> None:
        """Close all subscriptions and ports."""
        for subscription in self._subscriptions:
            subscription.close()
        for port in filter(None, self._ports.values()):
            port.close()
        self._socket.close()

    def _take(self, message: Message) -> None:
        key = keys.parse(message.key)
        device, bridge = key.device, key.ids.get("bridge", "")
        if self._wanted.devices and device not in self._wanted.devices:
            return
        if device not in self._ports and len(self._ports) < MOST_DEVICES:
            try:
                self._add(device)
            except OSError as error:
                _log.warning("%s: not shown: %s", device, error)
                self._ports[device] = None
        port = self._ports.get(device)
        if port is None:
            self.refused.add("of devices that have no port here")
        elif bridge and self._bridges.setdefault(device, bridge) != bridge:
            self.refused.add("of a second bridge")  # two streams must not be mixed
        elif key.what == "info":
            port.send(port.device.took_info(codec.decode_info(*message)))
        elif key.what == "raw":
            port.send(port.device.took_raw(codec.decode_samples(*message)))
        else:
            port.send(port.device.took_corrected(codec.decode_corrected(*message)))
        if port is not None and key.what == ("corrected" if self._wanted.corrected else "raw"):
            self._shown.add(device)

    def _add(self, device: str) -> None:
        shown = VirtualXimu3(self._wanted.ward, device, corrected=self._wanted.corrected)
        port = self._ports[device] = Port(shown, self._wanted.to.further(len(self._ports)))
        _log.info("%s: %s", device, port.place)

    def _announce(self) -> None:
        to, now_s = self._announce_to, time.monotonic()
        if to is None or now_s - self._announced_s < _ANNOUNCE_EVERY_S:
            return
        self._announced_s = now_s
        with contextlib.suppress(OSError):  # no listener, or no network
            ip = local(to.host)
            for port in filter(None, self._ports.values()):
                self._socket.sendto(port.announcement(ip), to)


def show(bus: Bus, wanted: Wanted, stop: threading.Event) -> None:
    """Show devices until stopped; raises OSError if a port is taken."""
    shown = Show(bus, wanted)
    try:
        while not stop.is_set() and not shown.over:
            shown.turn()
    finally:
        shown.close()
        if shown.refused.total():
            counts = (f"{n} {in_words(reason)}" for reason, n in shown.refused.as_dict().items())
            _log.info("messages not shown: %s", ", ".join(counts))
