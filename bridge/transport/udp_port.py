"""UDP transport for a device that sends datagrams here: `udp://[local host]:port[?from=host of the device]`."""

import contextlib
import socket

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.transport import network_errors, udp_listener, url
from bridge.transport.errors import DeviceLost, DeviceUnavailable
from bridge.transport.inbox import Inbox, Received, joined
from bridge.transport.transport import Chunk
from bridge.transport.udp_listener import ANYONE, Listener, Peer, Taken
from bridge.wire.refusal import Tally

EXAMPLE = "udp://:8000?from=10.0.0.5"
_FORGOTTEN_NS = 3_000_000_000
# Labels of `faults`, counted in datagrams: no room; from another device.
OVERFLOW, OTHERS = "datagrams_overflow", "datagrams_of_others"


class UdpPort:
    """UDP transport, which combines the datagrams of one device into a stream of bytes.

    address: the part behind `udp://`. baud: ignored. The option `from` of the address names the device's host, so that
    several devices can send to one port. Without `from`, only the first sending host is received, until it is silent
    for 3 s.
    """

    def __init__(self, address: str, baud: int) -> None:  # noqa: ARG002 - UDP has no baud rate
        self.place = f"udp://{address}"
        self.faults = Tally()
        self._host, self._port, self._from = parsed(address)
        self._joined: tuple[Listener, Inbox] | None = None

    def open(self) -> None:
        """Listen on the UDP port. Raises DeviceUnavailable if the port cannot be used."""
        self.close()
        self._peer: tuple[str, Peer] | None = None
        self._heard_ns = 0
        try:
            hosts = _numbers(self._from) if self._from else frozenset({ANYONE})
            self._joined = udp_listener.join(self._host, self._port, hosts)
        except OSError as error:
            raise DeviceUnavailable(network_errors.cause(error, self.place)) from None
        except Taken as taken:
            raise DeviceUnavailable(Code.PORT_TAKEN(place=self.place, taken=taken, example=EXAMPLE)) from None

    def read(self, timeout_s: float) -> Chunk:
        """Return the received datagrams as one chunk; waits at most timeout_s seconds for the first datagram.

        The chunk has no bytes if none came. Raises DeviceLost if the port is closed.
        """
        _, inbox = self._opened()
        heard = self._own(inbox.take(timeout_s))
        if lost := inbox.lost():
            self.faults.add(OVERFLOW, lost)
        if not heard:
            self._opened()
        return joined(heard)

    def _own(self, received: list[Received]) -> list[Received]:
        """Datagrams of the current device only: two devices must not be mixed in one stream."""
        heard = []
        for one in received:
            host = udp_listener.plain(one.sender[0])
            if self._peer is None or host == self._peer[0] or one.receive_time_ns - self._heard_ns >= _FORGOTTEN_NS:
                self._peer, self._heard_ns = (host, one.sender), one.receive_time_ns
                heard.append(one)
            else:
                self.faults.add(OTHERS)
        return heard

    def write(self, data: bytes) -> None:
        """Send data to the device from which the latest datagram came; before the first datagram, nothing is sent.

        Raises DeviceLost if the port is closed.
        """
        listener, _ = self._opened()
        if self._peer is not None:
            with contextlib.suppress(OSError):  # a datagram may be lost
                listener.send(data, self._peer[1])

    def close(self) -> None:
        """Stop listening on the UDP port; this ends a `read` in another thread."""
        was, self._joined = self._joined, None
        if was is not None:
            was[1].end()
            udp_listener.leave(*was)

    def _opened(self) -> tuple[Listener, Inbox]:
        opened = self._joined
        if opened is None:
            raise DeviceLost(Code.CLOSED(place=self.place))
        return opened


def parsed(address: str) -> tuple[str, int, str]:
    """Parse the part of a UDP address behind `udp://`; return (local host, port, the device's host).

    The local host is "" for all local addresses, the device's host is "" for any device. Raises ValueError
    if the address is invalid.
    """
    where, chosen = url.options(address, ("from",), EXAMPLE)
    host, port = url.host_port(where, EXAMPLE, host_needed=False)
    return host, port, url.host(chosen["from"], EXAMPLE) if "from" in chosen else ""


def state(address: str) -> str:
    """Return `free` if the local port of a UDP address can be opened, else the cause in words.

    Whether a device sends to the port is not tested. address: the part behind `udp://`. Raises ValueError for an
    invalid address.
    """
    host, port, _ = parsed(address)
    try:
        udp_listener.bound(host, port).close()
    except OSError as error:
        return english(network_errors.cause(error, f"udp://{address}"))
    return "free"


def _numbers(host: str) -> frozenset[str]:
    return frozenset(udp_listener.plain(str(found[4][0])) for found in socket.getaddrinfo(host, None))
