"""Subscribe to devices of a ward and show each as an x-IMU3, on ports of its own."""

import contextlib
import logging
import socket
import threading
import time
from dataclasses import dataclass

from bridge.bus.contract import Bus, BusError, Message, Subscription
from bridge.reasons.catalogue import in_words
from bridge.virtual_ximu3.device import VirtualXimu3
from bridge.virtual_ximu3.ports import Address, Ports, local
from bridge.wire import codec, keys
from bridge.wire.refusal import Reason, Refusal, Tally

_TURN_S = 0.02
_AT_ONCE = 4096
_ANNOUNCE_EVERY_S = 1.0
_PATIENCE_S = 2.0
MOST_DEVICES = 64
_MISSING = (
    "no %s rates of %s in ward %s yet: do bridge and estimator run (`truerate devices`)? --raw needs no estimator"
)

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Wanted:
    """What to show and where. No devices: all that are heard. Each next device has the next port of each kind.

    announce: the host or broadcast address to be told of them; None: nobody.
    """

    ward: str
    devices: tuple[str, ...] = ()
    corrected: bool = True
    udp: Address | None = None
    tcp: Address | None = None
    announce: Address | None = None


class Show:
    """The devices shown. `turn` does what is due and waits for no more than a moment; one thread."""

    def __init__(self, bus: Bus, wanted: Wanted) -> None:
        self.refused = Tally()
        self._wanted = wanted
        self._ports: dict[str, Ports] = {}
        self._without: set[str] = set()  # devices for which there was no port
        self._bridges: dict[str, str] = {}  # of devices, those that were heard first
        self._shown: set[str] = set()  # devices of which rates were passed on
        self._patient_until_s = time.monotonic() + _PATIENCE_S
        self._announced_s = float("-inf")
        self._announce_to = wanted.announce and wanted.announce.resolved()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self._subscriptions: list[Subscription] = []
        try:
            # Raw and info before corrected: accelerations and names come first.
            for what in ("raw", "info", *(("corrected",) if wanted.corrected else ())):
                self._subscriptions.append(bus.subscribe(keys.pattern(wanted.ward, what), history=what == "info"))
            for device in wanted.devices:
                self._add(device)
        except (OSError, BusError):
            self.close()
            raise

    def turn(self) -> None:
        """Pass on what came, answer, announce."""
        *others, last = self._subscriptions
        waited = last.drain(_AT_ONCE, _TURN_S)
        for messages in (*(subscription.drain(_AT_ONCE, 0.0) for subscription in others), waited):
            for message in messages:
                self._take(message)
        for ports in self._ports.values():
            ports.serve()
        self._announce()
        if time.monotonic() > self._patient_until_s:
            self._patient_until_s = float("inf")
            missing = [
                device for device in self._wanted.devices or self._ports or ("any device",) if device not in self._shown
            ]
            if missing:
                _log.warning(
                    _MISSING, "corrected" if self._wanted.corrected else "raw", ", ".join(missing), self._wanted.ward
                )

    @property
    def over(self) -> bool:
        """Nothing will ever come again."""
        return self._subscriptions[-1].closed

    def close(self) -> None:
        """Close every port."""
        for subscription in self._subscriptions:
            subscription.close()
        for ports in self._ports.values():
            ports.close()
        self._socket.close()

    def _take(self, message: Message) -> None:
        try:
            key = keys.parse(message.key)
            device = key.device
            if self._wanted.devices and device not in self._wanted.devices:
                return
            ports = self._ports.get(device) or self._found(device)
            if ports is None:
                self.refused.add("of devices that have no port here")
                return
            bridge = key.ids.get("bridge", "")
            if bridge and self._bridges.setdefault(device, bridge) != bridge:
                self.refused.add("of a second bridge")  # two streams in one would be none
                return
            ports.send(_passed_on(ports.device, key.what, message))
            if key.what == ("corrected" if self._wanted.corrected else "raw"):
                self._shown.add(device)
        except Refusal as refusal:
            self.refused.add(refusal.reason)

    def _found(self, device: str) -> Ports | None:
        """The ports of a device that was not heard before; None where there is no room for it."""
        if device in self._without or len(self._ports) + len(self._without) >= MOST_DEVICES:
            return None
        try:
            return self._add(device)
        except OSError as error:
            _log.warning("%s: not shown: %s", device, error)
            self._without.add(device)
            return None

    def _add(self, device: str) -> Ports:
        n = len(self._ports) + len(self._without)
        udp, tcp = self._wanted.udp, self._wanted.tcp
        shown = VirtualXimu3(self._wanted.ward, device, corrected=self._wanted.corrected)
        ports = Ports(shown, udp and udp.further(n), tcp and tcp.further(n))
        self._ports[device] = ports
        _log.info("%s: %s", device, ports.place)
        return ports

    def _announce(self) -> None:
        to, now_s = self._announce_to, time.monotonic()
        if to is None or now_s - self._announced_s < _ANNOUNCE_EVERY_S:
            return
        self._announced_s = now_s
        with contextlib.suppress(OSError):  # nobody listens, or no network now
            ip = local(to.host)
            for ports in self._ports.values():
                self._socket.sendto(ports.announcement(ip), to)


def show(bus: Bus, wanted: Wanted, stop: threading.Event) -> None:
    """Show them until stopped; raises OSError when a port is not to be had."""
    shown = Show(bus, wanted)
    try:
        while not stop.is_set() and not shown.over:
            shown.turn()
    finally:
        shown.close()
        if shown.refused.total():
            counts = (f"{n} {in_words(reason)}" for reason, n in shown.refused.as_dict().items())
            _log.info("messages that were not shown: %s", ", ".join(counts))


def _passed_on(device: VirtualXimu3, what: str, message: Message) -> list[bytes]:
    if what == "raw":
        return device.took_raw(codec.decode_samples(*message))
    if what == "info":
        return device.took_info(codec.decode_info(*message))
    if what == "corrected":
        return device.took_corrected(codec.decode_corrected(*message))
    raise Refusal(Reason.BAD_KEY, f"{what} was not subscribed to")
