"""One UDP port and everybody who waits at it: datagrams are told apart by the host they come from."""

import contextlib
import logging
import select
import socket
import threading
import time
from collections import deque
from typing import Any, Final, NamedTuple

from bridge.transport import host_time

ALL = "0.0.0.0"  # noqa: S104 - devices are on other machines
_LONGEST = 65_535
_BUFFER_BYTES = 1 << 21
_MOST_BYTES = 1 << 20  # that wait for one device
_AT_ONCE = 1024  # datagrams
_GATHER_S = 0.002  # so that one look finds what came of many devices; stamps are late by no more

_log = logging.getLogger(__name__)

Peer = tuple[Any, ...]  # as a socket names it: host, port, and more with IPv6


class Heard(NamedTuple):
    """Datagrams of one host, in one piece: the bytes, the host, who sent the last, and the host time right after that came."""

    data: bytes
    host: str
    sender: Peer
    receive_time_ns: int


class Taken(Exception):
    """Somebody waits for these datagrams already."""


class Channel:
    """One device's datagrams that wait to be read. `lost`: those there was no room for."""

    def __init__(self, hosts: frozenset[str]) -> None:
        self.hosts: Final = hosts
        self.lost = 0
        self._waiting: deque[Heard] = deque()
        self._bytes_in = self._bytes_out = 0  # each counted by one thread

    def offer(self, heard: Heard) -> None:
        """Keep it, if there is room."""
        if self._bytes_in - self._bytes_out >= _MOST_BYTES:
            self.lost += 1
            return
        self._bytes_in += len(heard.data)
        self._waiting.append(heard)

    def take(self) -> list[Heard]:
        """All that wait, up to some 64 kB."""
        taken, size = [], 0
        while self._waiting and size < _LONGEST:
            taken.append(self._waiting.popleft())
            size += len(taken[-1].data)
        self._bytes_out += size
        return taken


class Listener:
    """A bound socket, its thread, and the channels of those who wait at it. `join` makes and shares them."""

    def __init__(self, host: str, port: int) -> None:
        self.where: Final = (host, port)
        self._warned = False
        self._closed = False
        self._channels: dict[str, Channel] = {}
        self._anyone: Channel | None = None
        self._socket = bound(host, port)
        self._socket.settimeout(0)
        self._thread = threading.Thread(target=self._run, name=f"udp port {port}", daemon=True)
        self._thread.start()

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
        self._closed = True
        with contextlib.suppress(OSError):  # it is connected to nobody, but this ends the wait for datagrams
            self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        poll = select.poll()
        poll.register(self._socket, select.POLLIN)
        while poll.poll() and not self._closed:
            self._receive()
            time.sleep(_GATHER_S)

    def _receive(self) -> None:
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
            channel.offer(Heard(data, host, sender, host_time.now_ns()))
            return
        if not self._warned:
            self._warned = True
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
    """Wait no longer. The last one closes the port."""
    with _lock:
        if listener.remove(channel):
            del _listeners[listener.where]
            listener.close()


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
