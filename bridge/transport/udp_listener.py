"""UDP port shared by several devices: a datagram belongs to the device whose host sent it."""

import contextlib
import logging
import select
import socket
import threading
import time
from typing import Any, Final

from bridge.transport.inbox import Inbox

#: key of the inbox for all hosts without an inbox of their own
ANYONE = "anyone"
ALL = "0.0.0.0"  # noqa: S104 - devices are on other machines
_LONGEST = 65_535
_BUFFER_BYTES = 1 << 21
_MOST_BYTES = 1 << 20  # waiting for one device
_AT_ONCE = 1024  # datagrams
_GATHER_S = 0.002  # so that one wake-up finds the datagrams of many devices; receive times are late by at most this

_log = logging.getLogger(__name__)

Peer = tuple[Any, ...]  # as a socket gives it: host, port, and more with IPv6


class Taken(Exception):
    """Error: another device already receives the datagrams of these hosts; the message lists the hosts."""


class Listener:
    """UDP socket with its own thread, which sorts datagrams into the inboxes of devices by their sending host.

    host, port: local address. Devices on the same port share one listener, which `join` returns. Raises OSError if the
    port is unusable.
    """

    def __init__(self, host: str, port: int) -> None:
        self.where: Final = (host, port)
        self._warned = False
        self._closed = False
        self._inboxes: dict[str, Inbox] = {}
        self._socket = bound(host, port)
        self._socket.settimeout(0)
        self._thread = threading.Thread(target=self._run, name=f"udp port {port}", daemon=True)
        self._thread.start()

    def send(self, data: bytes, to: Peer) -> None:
        """Send a datagram to a device from this listener's port. Raises OSError if that fails.

        to: the device's address, as `socket.recvfrom` gives it.
        """
        self._socket.sendto(data, to)

    def add(self, inbox: Inbox, hosts: frozenset[str]) -> None:
        """Add a device's inbox, which receives the datagrams from its hosts from now on.

        hosts: IP addresses from which the device sends, or ANYONE for every host without an inbox of its own. Raises
        Taken if a host has an inbox already.
        """
        if taken := self._inboxes.keys() & hosts:
            raise Taken(", ".join(sorted(taken)))
        # a new dict, because the thread reads the old one
        self._inboxes = self._inboxes | dict.fromkeys(hosts, inbox)

    def remove(self, inbox: Inbox) -> bool:
        """Remove a device's inbox; return True if no inbox is left."""
        self._inboxes = {host: other for host, other in self._inboxes.items() if other is not inbox}
        return not self._inboxes

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
        inbox = self._inboxes.get(host, self._inboxes.get(ANYONE))
        if inbox is not None:
            inbox.put(data, sender)
            return
        if not self._warned:
            self._warned = True
            _log.warning("udp port %d: ignoring datagrams from %s, where no device is configured", self.where[1], host)


_lock = threading.Lock()
_listeners: dict[tuple[str, int], Listener] = {}


def join(host: str, port: int, hosts: frozenset[str]) -> tuple[Listener, Inbox]:
    """Listen for the datagrams of one device on a UDP port; return the port's shared listener and the device's new inbox.

    host: local address; "" for all. hosts: IP addresses from which the device sends, or ANYONE.
    Raises OSError if the port is unusable, and Taken if a host has an inbox already.
    """
    inbox = Inbox(_MOST_BYTES)
    where = (host or ALL, port)
    with _lock:
        listener = _listeners.get(where) or Listener(*where)
        listener.add(inbox, hosts)
        _listeners[where] = listener
    return listener, inbox


def leave(listener: Listener, inbox: Inbox) -> None:
    """Remove an inbox from its listener; close the port if no inbox is left."""
    with _lock:
        if listener.remove(inbox):
            del _listeners[listener.where]
            listener.close()


def bound(host: str, port: int) -> socket.socket:
    """Return a UDP socket bound to a local address and port. Raises OSError if that fails.

    host: local address; "" for all IPv4 addresses of this machine, `::` for all IPv4 and IPv6 addresses.
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
    """Return an IP address; an IPv4-mapped IPv6 address (`::ffff:10.0.0.5`) is returned as IPv4 (`10.0.0.5`)."""
    return host.removeprefix("::ffff:")
