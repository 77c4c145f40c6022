"""The UDP socket of one virtual x-IMU3. Nothing here blocks."""

import contextlib
import json
import math
import socket
from typing import NamedTuple, Self

from bridge.runtime import os_errors
from bridge.virtual_ximu3.device import VirtualXimu3

ANNOUNCED_AT = 10_000
REPLY_PORT = 1000  # a device listens this far above the port it sends to: 9000 for 8000, as x-io's do
_DATAGRAM = 1400
_LONGEST_COMMAND = 1024
_COMMANDS = 64  # commands handled per turn, so that other devices get theirs


class Address(NamedTuple):
    """A host and a port."""

    host: str
    port: int

    def further(self, n: int) -> Self:
        """Address of the n-th device: the port plus n."""
        return self._replace(port=self.port + n)

    def resolved(self) -> Self:
        """The address with the host as an IPv4 number; raises OSError for an unknown name."""
        try:
            return self._replace(host=socket.gethostbyname(self.host))
        except OSError as error:
            raise OSError(f"unknown host {self.host!r}: check its spelling, or give its numeric address") from error


class Port:
    """Socket of one virtual device, sending to one address. Raises OSError if the port is taken."""

    def __init__(self, device: VirtualXimu3, to: Address) -> None:
        self.device = device
        self._to = to.resolved()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        at = Address(local(self._to.host), self._to.port + REPLY_PORT)
        try:
            self._socket.bind(at)
        except OSError as error:
            self._socket.close()
            raise OSError(f"port {at.host}:{at.port}: {os_errors.why(error)}; choose another port") from None
        self._socket.settimeout(0.0)

    @property
    def place(self) -> str:
        """The addresses, for people who type them in."""
        return f"UDP to {self._to.host}:{self._to.port}, commands at {self._to.port + REPLY_PORT}"

    def send(self, messages: list[bytes]) -> None:
        """Send messages in datagrams of whole messages."""
        datagram = b""
        for message in messages:
            if len(datagram) + len(message) > _DATAGRAM:
                self._send(datagram, self._to)
                datagram = b""
            datagram += message
        if datagram:
            self._send(datagram, self._to)

    def serve(self) -> None:
        """Answer the commands received."""
        for _ in range(_COMMANDS):
            try:
                data, sender = self._socket.recvfrom(_LONGEST_COMMAND)
            except BlockingIOError:
                return
            except OSError:  # an earlier datagram was refused
                continue
            for line in data.split(b"\n"):
                if line and (answer := self.device.answer(line)):
                    self._send(answer, sender)

    def announcement(self, ip: str) -> bytes:
        """The announcement that makes x-io's programs find the device.

        It has no `sync` field, because real devices would set their clocks by it.
        """
        battery = self.device.battery_percent
        said = {
            "name": self.device.name,
            "sn": self.device.serial,
            "ip": ip,
            "port": 0,
            "send": self._to.port,
            "receive": self._to.port + REPLY_PORT,
            "rssi": -1,
            "battery": -1 if math.isnan(battery) else round(battery),
            "status": int(self.device.charging),
        }
        return json.dumps(said, separators=(",", ":")).encode()

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _send(self, data: bytes, to: tuple[str, int]) -> None:
        with contextlib.suppress(OSError):  # no receiver, or no room: a datagram may be lost
            self._socket.sendto(data, to)


def local(host: str) -> str:
    """The local address used towards a host; loopback stays loopback."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        probe.connect((host, 9))
        return str(probe.getsockname()[0])
