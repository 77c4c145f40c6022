"""A device that sends datagrams to us: `udp://[host of ours]:port[?from=host of the device]`."""

import contextlib
import socket

from bridge import host_time
from bridge.drivers.driver import DeviceLost, DeviceUnavailable
from bridge.transport import net_fault, udp_listener, url
from bridge.transport.transport import Chunk
from bridge.transport.udp_listener import Channel, Listener, Peer, Taken
from bridge.wire.refusal import Tally

EXAMPLE = "udp://:8000?from=10.0.0.5"
_FORGOTTEN_NS = 3_000_000_000
# What `faults` counts, in datagrams: no room for them, of another device, of hosts that no device of ours is at.
OVERFLOW, OTHERS, STRANGERS = "datagrams_overflow", "datagrams_of_others", "datagrams_of_strangers"


class UdpPort:
    """One device's datagrams. Without `from`, those of the first host that is heard, until it has been silent for 3 s.

    Several devices may send to one port, told apart by `from`.
    """

    keeps = True

    def __init__(self, address: str, baud: int) -> None:  # noqa: ARG002 - a network has no speed
        self.place = f"udp://{address}"
        self.faults = Tally()
        self._host, self._port, self._from = parsed(address)
        self._joined: tuple[Listener, Channel] | None = None

    def open(self) -> None:
        """Listen; raises DeviceUnavailable."""
        self.close()
        self._peer: tuple[str, Peer] | None = None
        self._heard_ns = self._lost = 0
        try:
            hosts = _numbers(self._from) if self._from else frozenset[str]()
            self._joined = udp_listener.join(self._host, self._port, hosts)
        except OSError as error:
            raise DeviceUnavailable(net_fault.cause(error, self.place)) from None
        except Taken as taken:
            raise DeviceUnavailable(
                f"{self.place}: busy; another device of this bridge takes datagrams of {taken} there: "
                f"tell them apart by their hosts, as in {EXAMPLE}"
            ) from None
        self._strangers = self._joined[0].strangers

    def read(self, timeout_s: float) -> Chunk:
        """The next datagram; raises DeviceLost once closed."""
        listener, channel = self._opened()
        self._account(listener, channel)
        while (datagram := channel.kept.take(timeout_s)) is not None:
            data, host, sender, receive_time_ns = datagram
            if self._peer is None or host == self._peer[0] or receive_time_ns - self._heard_ns >= _FORGOTTEN_NS:
                self._peer, self._heard_ns = (host, sender), receive_time_ns
                return Chunk(data, receive_time_ns)
            self.faults.add(OTHERS)  # two devices in one stream would be no stream
        self._opened()
        return Chunk(b"", host_time.now_ns())

    def write(self, data: bytes) -> None:
        """Send to where the latest datagram came from; nowhere before there was one. Raises DeviceLost once closed."""
        listener, _ = self._opened()
        if self._peer is not None:
            with contextlib.suppress(OSError):  # a datagram may be lost
                listener.send(data, self._peer[1])

    def close(self) -> None:
        """Listen no more, ending a read in another thread."""
        joined, self._joined = self._joined, None
        if joined is not None:
            udp_listener.leave(*joined)

    def _opened(self) -> tuple[Listener, Channel]:
        joined = self._joined
        if joined is None:
            raise DeviceLost(f"{self.place}: closed")
        return joined

    def _account(self, listener: Listener, channel: Channel) -> None:
        lost, strangers = channel.lost, listener.strangers
        if lost > self._lost:
            self.faults.add(OVERFLOW, lost - self._lost)
        if strangers > self._strangers:
            self.faults.add(STRANGERS, strangers - self._strangers)
        self._lost, self._strangers = lost, strangers


def parsed(address: str) -> tuple[str, int, str]:
    """Our host (empty: all), port, and the device's host (empty: any); ValueError where they are none."""
    where, chosen = url.options(address, ("from",), EXAMPLE)
    host, port = url.host_port(where, EXAMPLE, host_needed=False)
    return host, port, url.host(chosen["from"], EXAMPLE) if "from" in chosen else ""


def state(address: str) -> str:
    """Whether its port can be listened on now, in a few words; whether a device sends to it nobody knows before."""
    host, port, _ = parsed(address)
    try:
        udp_listener.bound(host, port).close()
    except OSError as error:
        return net_fault.cause(error, "").removeprefix(": ")
    return "free to be listened on"


def _numbers(host: str) -> frozenset[str]:
    return frozenset(udp_listener.plain(str(found[4][0])) for found in socket.getaddrinfo(host, None))
