"""UDP transport for a device that sends datagrams here: `udp://[local host]:port[?from=host of the device]`."""

import contextlib
import socket
import threading
import time

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.transport import host_time, network_errors, udp_listener, url
from bridge.transport.errors import DeviceLost, DeviceUnavailable
from bridge.transport.transport import Chunk
from bridge.transport.udp_listener import Channel, Heard, Listener, Peer, Taken
from bridge.wire.refusal import Tally

EXAMPLE = "udp://:8000?from=10.0.0.5"
_FORGOTTEN_NS = 3_000_000_000
_TURN_S = 0.01
# Labels of `faults`, counted in datagrams: no room; from another device.
OVERFLOW, OTHERS = "datagrams_overflow", "datagrams_of_others"


class UdpPort:
    """UDP transport: the datagrams of one device, joined to a stream of bytes. address: the part behind `udp://`.

    Without `from`, those of the first host heard, until it has been silent for 3 s.
    Several devices may send to one port, told apart by `from`.
    """

    def __init__(self, address: str, baud: int) -> None:  # noqa: ARG002 - UDP has no baud rate
        self.place = f"udp://{address}"
        self.faults = Tally()
        self._host, self._port, self._from = parsed(address)
        self._joined: tuple[Listener, Channel] | None = None
        self._closed = threading.Event()

    def open(self) -> None:
        """Listen on the UDP port. Raises DeviceUnavailable."""
        self.close()
        self._peer: tuple[str, Peer] | None = None
        self._heard_ns = self._lost = 0
        try:
            hosts = _numbers(self._from) if self._from else frozenset[str]()
            self._joined = udp_listener.join(self._host, self._port, hosts)
        except OSError as error:
            raise DeviceUnavailable(network_errors.cause(error, self.place)) from None
        except Taken as taken:
            raise DeviceUnavailable(Code.PORT_TAKEN(place=self.place, taken=taken, example=EXAMPLE)) from None
        self._closed.clear()

    def read(self, timeout_s: float) -> Chunk:
        """Return the received datagrams as one chunk, waiting at most timeout_s for the first; empty if none.

        Raises DeviceLost once closed.
        """
        until_s = time.monotonic() + timeout_s
        while not (heard := self._heard()):
            left_s = until_s - time.monotonic()
            if left_s <= 0:
                return Chunk(b"", host_time.now_ns())
            self._closed.wait(min(left_s, _TURN_S))
        return Chunk(b"".join(part.data for part in heard), heard[-1].receive_time_ns)

    def _heard(self) -> list[Heard]:
        """Datagrams of the current device only: two devices must not be mixed in one stream."""
        _, channel = self._opened()
        if channel.lost > self._lost:
            self.faults.add(OVERFLOW, channel.lost - self._lost)
            self._lost = channel.lost
        heard = []
        for one in channel.take():
            if self._peer is None or one.host == self._peer[0] or one.receive_time_ns - self._heard_ns >= _FORGOTTEN_NS:
                self._peer, self._heard_ns = (one.host, one.sender), one.receive_time_ns
                heard.append(one)
            else:
                self.faults.add(OTHERS)
        return heard

    def write(self, data: bytes) -> None:
        """Send data to the sender of the latest datagram; does nothing before the first.

        Raises DeviceLost once closed.
        """
        listener, _ = self._opened()
        if self._peer is not None:
            with contextlib.suppress(OSError):  # a datagram may be lost
                listener.send(data, self._peer[1])

    def close(self) -> None:
        """Stop listening on the UDP port; this ends a read in another thread."""
        joined, self._joined = self._joined, None
        self._closed.set()
        if joined is not None:
            udp_listener.leave(*joined)

    def _opened(self) -> tuple[Listener, Channel]:
        joined = self._joined
        if joined is None:
            raise DeviceLost(Code.CLOSED(place=self.place))
        return joined


def parsed(address: str) -> tuple[str, int, str]:
    """Parse the part of an address behind `udp://`: local host (empty: all), port, and the device's host (empty: any).

    Raises ValueError if invalid.
    """
    where, chosen = url.options(address, ("from",), EXAMPLE)
    host, port = url.host_port(where, EXAMPLE, host_needed=False)
    return host, port, url.host(chosen["from"], EXAMPLE) if "from" in chosen else ""


def state(address: str) -> str:
    """Return in a few words whether the UDP port can be listened on now; `free` if so.

    Whether a device sends is unknown before opening.
    """
    host, port, _ = parsed(address)
    try:
        udp_listener.bound(host, port).close()
    except OSError as error:
        return english(network_errors.cause(error, f"udp://{address}"))
    return "free"


def _numbers(host: str) -> frozenset[str]:
    return frozenset(udp_listener.plain(str(found[4][0])) for found in socket.getaddrinfo(host, None))
