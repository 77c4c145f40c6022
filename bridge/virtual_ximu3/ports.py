"""Where x-io's programs find one virtual x-IMU3: a UDP socket, and a TCP port for up to a few clients. Nothing here waits."""

import contextlib
import json
import math
import socket
from typing import NamedTuple, Self

from bridge import os_words
from bridge.framing.lines import Lines
from bridge.virtual_ximu3.device import VirtualXimu3

ANNOUNCED_AT = 10_000
REPLY_PORT = 1000  # what a device listens on is so much above what it sends to: 9000 for 8000, as x-io has it
_DATAGRAM = 1400
_LONGEST_COMMAND = 1024
_MOST_CLIENTS = 8
_COMMANDS = 64  # of one connection, before the others have their turn


class Address(NamedTuple):
    """A host and a port."""

    host: str
    port: int

    def further(self, n: int) -> Self:
        """The n-th device's."""
        return self._replace(port=self.port + n)

    def resolved(self) -> Self:
        """With the host as a number; raises OSError where the name is not known."""
        try:
            return self._replace(host=socket.gethostbyname(self.host))
        except OSError as error:
            raise OSError(
                f"host {self.host!r} is not known; check its spelling, or give its address in numbers"
            ) from error


class _Client:
    """One TCP connection."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)  # noqa: FBT003 - the socket's own word
        self.connection = connection
        self.lines = Lines(_LONGEST_COMMAND)


class Ports:
    """One virtual device's. udp: where it sends; tcp: where it listens. Raises OSError when a port is not to be had."""

    def __init__(self, device: VirtualXimu3, udp: Address | None, tcp: Address | None) -> None:
        self.device = device
        self._udp_to = udp = udp and udp.resolved()
        self._udp = self._listener = None
        self._clients: list[_Client] = []
        try:
            if udp:
                self._udp = _bound(socket.SOCK_DGRAM, Address(local(udp.host), udp.port + REPLY_PORT))
            if tcp:
                self._listener = _bound(socket.SOCK_STREAM, tcp)
                self._listener.listen(_MOST_CLIENTS)
        except OSError:
            self.close()
            raise

    @property
    def place(self) -> str:
        """Where it is, for people who type it in."""
        places = []
        if self._udp is not None and self._udp_to is not None:
            places.append(f"UDP to {self._udp_to.host}:{self._udp_to.port}, commands at {self._udp.getsockname()[1]}")
        if self._listener is not None:
            host, port = self._listener.getsockname()
            places.append(f"TCP at {host}:{port}")
        return ", ".join(places)

    def send(self, messages: list[bytes]) -> None:
        """Send to whoever listens; UDP in datagrams of whole messages."""
        for client in tuple(self._clients):
            self._tell(client, b"".join(messages))
        if self._udp is None or self._udp_to is None:
            return
        datagram = b""
        for message in messages:
            if len(datagram) + len(message) > _DATAGRAM:
                self._datagram(datagram, self._udp_to)
                datagram = b""
            datagram += message
        if datagram:
            self._datagram(datagram, self._udp_to)

    def serve(self) -> None:
        """Answer the commands that came, and take new clients."""
        self._serve_udp()
        self._accept()
        for client in tuple(self._clients):
            self._serve_client(client)

    def announcement(self, ip: str) -> bytes:
        """What tells x-io's programs that it is there. Without `sync`: real devices would set their clocks by it."""
        battery = self.device.battery_percent
        said = {
            "name": self.device.name,
            "sn": self.device.serial,
            "ip": ip,
            "port": 0 if self._listener is None else self._listener.getsockname()[1],
            "send": self._udp_to.port if self._udp_to else 0,
            "receive": 0 if self._udp is None else self._udp.getsockname()[1],
            "rssi": -1,
            "battery": -1 if math.isnan(battery) else round(battery),
            "status": int(self.device.charging),
        }
        return json.dumps(said, separators=(",", ":")).encode()

    def close(self) -> None:
        """Close everything."""
        for one in (self._udp, self._listener, *(client.connection for client in self._clients)):
            if one is not None:
                one.close()

    def _datagram(self, data: bytes, to: tuple[str, int]) -> None:
        if self._udp is not None:
            with contextlib.suppress(OSError):  # nobody there, or no room: a datagram may be lost
                self._udp.sendto(data, to)

    def _serve_udp(self) -> None:
        for _ in range(_COMMANDS if self._udp else 0):
            try:
                data, sender = self._udp.recvfrom(_LONGEST_COMMAND)  # type: ignore[union-attr] # the range is empty then
            except BlockingIOError:
                return
            except OSError:  # what was sent before found nobody
                continue
            for line in data.split(b"\n"):
                if line and (answer := self.device.answer(line, "UDP")):
                    self._datagram(answer, sender)

    def _accept(self) -> None:
        for _ in range(_MOST_CLIENTS if self._listener else 0):
            try:
                connection, _ = self._listener.accept()  # type: ignore[union-attr] # the range is empty then
            except OSError:  # nobody more, or gone again
                return
            if len(self._clients) < _MOST_CLIENTS:
                self._clients.append(_Client(connection))
            else:
                connection.close()

    def _serve_client(self, client: _Client) -> None:
        try:
            data = client.connection.recv(_LONGEST_COMMAND)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self._tell(client, b"".join(self.device.answer(line.data, "TCP") for line in client.lines.feed(data)))
        else:
            self._leave(client)

    def _tell(self, client: _Client, data: bytes) -> None:
        try:
            client.connection.sendall(data)
        except OSError:  # it is gone, or does not read: the system keeps some seconds for it
            self._leave(client)

    def _leave(self, client: _Client) -> None:
        if client in self._clients:
            self._clients.remove(client)
        client.connection.close()


def _bound(kind: socket.SocketKind, at: Address) -> socket.socket:
    made = socket.socket(socket.AF_INET, kind)
    try:
        if kind is socket.SOCK_STREAM:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind(at)
    except OSError as error:
        made.close()
        raise OSError(f"{at.host}:{at.port} is not to be had: {os_words.why(error)}; choose another port") from None
    made.setblocking(False)  # noqa: FBT003 - the socket's own word
    return made


def local(host: str) -> str:
    """Our own address towards a host; loopback stays loopback."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        probe.connect((host, 9))
        return str(probe.getsockname()[0])
