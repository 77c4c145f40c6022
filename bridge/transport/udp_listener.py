"""Shares one UDP port among devices: datagrams are told apart by the sending host."""

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
_MOST_BYTES = 1 << 20  # waiting for one device
_AT_ONCE = 1024  # datagrams
_GATHER_S = 0.002  # so that one wake-up finds the datagrams of many devices; receive times are late by at most this

_log = logging.getLogger(__name__)

Peer = tuple[Any, ...]  # as a socket gives it: host, port, and more with IPv6


class Heard(NamedTuple):
    """One datagram as received: data, sending host, sender's socket address, and host receive time in ns."""

    data: bytes
    host: str
    sender: Peer
    receive_time_ns: int


class Taken(Exception):
    """The datagrams of a host already have a channel; the message names the hosts."""


class Channel:
    """Queue of one device's received datagrams, up to 1 MiB.

    hosts: addresses of the device; empty: any host without a channel. lost: number of datagrams dropped for lack of
    room.
    """

    def __init__(self, hosts: frozenset[str]) -> None:
        self.hosts: Final = hosts
        self.lost = 0
        self._waiting: deque[Heard] = deque()
        self._bytes_in = self._bytes_out = 0  # each is written by one thread only

    def offer(self, heard: Heard) -> None:
        """Queue a datagram if there is room; otherwise count it as lost."""
        if self._bytes_in - self._bytes_out >= _MOST_BYTES:
            self.lost += 1
            return
        self._bytes_in += len(heard.data)
        self._waiting.append(heard)

    def take(self) -> list[Heard]:
        """Return the waiting datagrams, oldest first, up to some 64 kB."""
        taken, size = [], 0
        while self._waiting and size < _LONGEST:
            taken.append(self._waiting.popleft())
            size += len(taken[-1].data)
        self._bytes_out += size
        return taken


class Listener:
    """A bound UDP socket with its thread, which sorts datagrams into the channels of devices by their sending host.

    `join` makes listeners and shares them.
    """

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
        """Send a datagram to a device, from the port that the device sends to; raises OSError."""
        self._socket.sendto(data, to)

    def add(self, channel: Channel) -> None:
        """Add a device's channel for its hosts, or for all hosts without a channel of their own; raises Taken."""
        taken = self._channels.keys() & channel.hosts
        if taken or (not channel.hosts and self._anyone is not None):
            raise Taken(", ".join(sorted(taken)) or "anyone")
        # a new dict, because the thread reads the old one
        self._channels = self._channels | dict.fromkeys(channel.hosts, channel)
        if not channel.hosts:
            self._anyone = channel

    def remove(self, channel: Channel) -> bool:
        """Remove a device's channel; return True if no channel is left."""
        self._channels = {host: other for host, other in self._channels.items() if other is not channel}
        if self._anyone is channel:
            self._anyone = None
        return not self._channels and self._anyone is None

    def close(self) -> None:
        """Stop the listener's thread and free the UDP port."""
        self._closed = True
        with contextlib.suppress(OSError):  # the socket is not connected, but shutdown ends the wait for datagrams
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
            except OSError:  # no more datagrams, or closed
                return
            self._sort(data, plain(sender[0]), sender)

    def _sort(self, data: bytes, host: str, sender: Peer) -> None:
        channel = self._channels.get(host, self._anyone)
        if channel is not None:
            channel.offer(Heard(data, host, sender, host_time.now_ns()))
            return
        if not self._warned:
            self._warned = True
            _log.warning("udp port %d: ignoring datagrams from %s, where no device is configured", self.where[1], host)


_lock = threading.Lock()
_listeners: dict[tuple[str, int], Listener] = {}


def join(host: str, port: int, hosts: frozenset[str]) -> tuple[Listener, Channel]:
    """Listen for the datagrams of these hosts on a UDP port; return the shared listener and a new channel.

    host: local address, empty for all. hosts: addresses of the device; empty for all hosts without a channel of their
    own.
    Raises OSError and Taken.
    """
    channel = Channel(hosts)
    where = (host or ALL, port)
    with _lock:
        listener = _listeners.get(where) or Listener(*where)
        listener.add(channel)
        _listeners[where] = listener
    return listener, channel


def leave(listener: Listener, channel: Channel) -> None:
    """Remove a channel from its listener; removing the last one closes the port."""
    with _lock:
        if listener.remove(channel):
            del _listeners[listener.where]
            listener.close()


def bound(host: str, port: int) -> socket.socket:
    """Return a UDP socket bound to a local host and port; raises OSError.

    Empty host: all IPv4 addresses of this machine; `::`: all IPv4 and IPv6 addresses.
    """
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
    """Return a host's address in its usual form: an IPv4-mapped IPv6 address becomes IPv4."""
    return host.removeprefix("::ffff:")
