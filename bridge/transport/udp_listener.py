"""One UDP port and everybody who waits at it: datagrams are told apart by the host they come from."""

import logging
import socket
import threading
from typing import Any, Final, NamedTuple

from bridge import host_time
from bridge.transport.receiver import RECEIVER, Kept

ALL = "0.0.0.0"  # noqa: S104 - devices are on other machines
_LONGEST = 65_535
_BUFFER_BYTES = 1 << 21
_AT_ONCE = 64  # datagrams, before other ports have their turn

_log = logging.getLogger(__name__)

Peer = tuple[Any, ...]  # as a socket names it: host, port, and more with IPv6


class Datagram(NamedTuple):
    """One, with the host it is from, who sent it, and the host time right after it came."""

    data: bytes
    host: str
    sender: Peer
    receive_time_ns: int


class Taken(Exception):
    """Somebody waits for these datagrams already."""


class Channel:
    """Where one device's datagrams wait. `lost`: those there was no room for."""

    def __init__(self, hosts: frozenset[str]) -> None:
        self.hosts: Final = hosts
        self.kept: Kept[Datagram] = Kept()
        self.lost = 0

    def offer(self, datagram: Datagram) -> None:
        """Keep it, if there is room."""
        if self.kept.full:
            self.lost += 1
        else:
            self.kept.put(datagram, max(1, len(datagram.data)))


class Listener:
    """A bound socket and the channels of those who wait at it. `join` makes and shares them."""

    def __init__(self, host: str, port: int) -> None:
        self.where: Final = (host, port)
        self.strangers = 0  # datagrams of hosts that nobody waits for
        self._channels: dict[str, Channel] = {}
        self._anyone: Channel | None = None
        self._socket = bound(host, port)
        self._socket.settimeout(0)
        RECEIVER.add(self._socket.fileno(), self._receive)

    def send(self, data: bytes, to: Peer) -> None:
        """A datagram to a device, from the port it sends to; raises OSError."""
        self._socket.sendto(data, to)

    def add(self, channel: Channel) -> None:
        """Give it what comes from its hosts, or from all that nobody else waits for; raises Taken."""
        taken = self._channels.keys() & channel.hosts
        if taken or (not channel.hosts and self._anyone is not None):
            raise Taken(", ".join(sorted(taken)) or "anyone")
        self._channels = self._channels | dict.fromkeys(channel.hosts, channel)  # anew: it is read meanwhile
        if not channel.hosts:
            self._anyone = channel

    def remove(self, channel: Channel) -> bool:
        """True when nobody is left."""
        self._channels = {host: other for host, other in self._channels.items() if other is not channel}
        if self._anyone is channel:
            self._anyone = None
        return not self._channels and self._anyone is None

    def close(self) -> None:
        """Free the port."""
        RECEIVER.remove(self._socket.fileno())
        self._socket.close()

    def _receive(self) -> None:
        """In the receiver's thread."""
        for _ in range(_AT_ONCE):
            try:
                data, sender = self._socket.recvfrom(_LONGEST)
            except ConnectionError:  # an earlier answer was refused
                continue
            except OSError:  # no more, or closed
                return
            self._sort(data, plain(sender[0]), sender)

    def _sort(self, data: bytes, host: str, sender: Peer) -> None:
        channel = self._channels.get(host, self._anyone)
        if channel is not None:
            channel.offer(Datagram(data, host, sender, host_time.now_ns()))
            return
        self.strangers += 1
        if self.strangers == 1:
            _log.warning("udp port %d: datagrams from %s, which no device is expected at", self.where[1], host)


_lock = threading.Lock()
_listeners: dict[tuple[str, int], Listener] = {}


def join(host: str, port: int, hosts: frozenset[str]) -> tuple[Listener, Channel]:
    """Wait for datagrams of these hosts, or of all others where there are none; raises OSError and Taken."""
    channel = Channel(hosts)
    where = (host or ALL, port)
    with _lock:
        listener = _listeners.get(where) or Listener(*where)
        listener.add(channel)
        _listeners[where] = listener
    return listener, channel


def leave(listener: Listener, channel: Channel) -> None:
    """Wait no longer; whoever waits for the channel is woken. The last one closes the port."""
    with _lock:
        if listener.remove(channel):
            del _listeners[listener.where]
            listener.close()
    channel.kept.end()


def bound(host: str, port: int) -> socket.socket:
    """A socket that listens; raises OSError. No host: all of this machine's IPv4 addresses; `::`: all of both kinds."""
    family, kind, protocol, _, where = socket.getaddrinfo(
        host or ALL, port, type=socket.SOCK_DGRAM, flags=socket.AI_PASSIVE
    )[0]
    made = socket.socket(family, kind, protocol)
    try:
        made.setsockopt(
            socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES
        )  # the system may give less: net.core.rmem_max
        if family == socket.AF_INET6:
            made.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)
        made.bind(where)
    except OSError:
        made.close()
        raise
    return made


def plain(host: str) -> str:
    """A host's numbers as everybody writes them: an IPv4 address that came over IPv6 is one again."""
    return host.removeprefix("::ffff:")
