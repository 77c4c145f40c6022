"""One UDP port and everybody who waits at it: datagrams are told apart by the host they come from."""

import contextlib
import logging
import socket
import threading
import time
from queue import SimpleQueue
from typing import Any, Final, NamedTuple

_LONGEST = 65_535
ALL = "0.0.0.0"  # noqa: S104 - devices are on other machines
_MOST_WAITING = 256  # datagrams; seconds of a usual device

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
    """Where one device's datagrams wait; None in `queue` ends the waiting. `lost`: those there was no room for."""

    def __init__(self, hosts: frozenset[str]) -> None:
        self.hosts: Final = hosts
        self.queue: SimpleQueue[Datagram | None] = SimpleQueue()
        self.lost = 0

    def offer(self, datagram: Datagram) -> None:
        """Keep it, if there is room."""
        if self.queue.qsize() >= _MOST_WAITING:
            self.lost += 1
        else:
            self.queue.put(datagram)


class Listener:
    """A bound socket and the thread that reads it, for as long as a channel is open. `join` makes and shares them."""

    def __init__(self, host: str, port: int) -> None:
        self.strangers = 0  # datagrams of hosts that nobody waits for
        self.where: Final = (host, port)
        self._closing = False
        self._socket = bound(host, port)
        self._channels: dict[str, Channel] = {}
        self._anyone: Channel | None = None
        self._thread = threading.Thread(target=self._run, name=f"udp {port}", daemon=True)
        self._thread.start()

    def send(self, data: bytes, to: Peer) -> None:
        """A datagram to a device, from the port it sends to; raises OSError."""
        self._socket.sendto(data, to)

    def _add(self, channel: Channel) -> None:
        taken = self._channels.keys() & channel.hosts
        if taken or (not channel.hosts and self._anyone is not None):
            raise Taken(", ".join(sorted(taken)) or "anyone")
        self._channels = self._channels | dict.fromkeys(channel.hosts, channel)  # anew: its thread reads it meanwhile
        if not channel.hosts:
            self._anyone = channel

    def _remove(self, channel: Channel) -> bool:
        """True when nobody is left."""
        self._channels = {host: other for host, other in self._channels.items() if other is not channel}
        if self._anyone is channel:
            self._anyone = None
        return not self._channels and self._anyone is None

    def _close(self) -> None:
        self._closing = True
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)  # wakes the thread, though there is no connection
        self._thread.join(1.0)
        self._socket.close()

    def _run(self) -> None:
        while True:
            try:
                data, sender = self._socket.recvfrom(_LONGEST)
            except ConnectionError:  # an earlier answer was refused
                continue
            except OSError:
                return
            if self._closing:
                return
            host = plain(sender[0])
            channel = self._channels.get(host, self._anyone)
            if channel is not None:
                channel.offer(Datagram(data, host, sender, time.time_ns()))
                continue
            self.strangers += 1
            if self.strangers == 1:
                _log.warning("udp port %d: datagrams from %s, which no device is expected at", self.where[1], host)


_lock = threading.Lock()
_listeners: dict[tuple[str, int], Listener] = {}


def join(host: str, port: int, hosts: frozenset[str]) -> tuple[Listener, Channel]:
    """Wait for datagrams of these hosts, or of all others where there are none; raises OSError and Taken."""
    channel = Channel(hosts)
    host = host or ALL
    with _lock:
        listener = _listeners.get((host, port)) or Listener(host, port)
        listener._add(channel)  # noqa: SLF001 - of this file
        _listeners[host, port] = listener
    return listener, channel


def leave(listener: Listener, channel: Channel) -> None:
    """Wait no longer; whoever waits for the channel is woken. The last one closes the port."""
    with _lock:
        if listener._remove(channel):  # noqa: SLF001 - of this file
            del _listeners[listener.where]
            listener._close()  # noqa: SLF001 - of this file
    channel.queue.put(None)


def bound(host: str, port: int) -> socket.socket:
    """A socket that listens; raises OSError. No host: all of this machine's IPv4 addresses; `::`: all of both kinds."""
    family, kind, protocol, _, where = socket.getaddrinfo(
        host or ALL,
        port,
        type=socket.SOCK_DGRAM,
        flags=socket.AI_PASSIVE,
    )[0]
    made = socket.socket(family, kind, protocol)
    try:
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
