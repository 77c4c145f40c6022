"""A client of Foxglove's WebSocket protocol, written from its specification (foxglove/ws-protocol, docs/spec.md)."""

import json
import re
import struct
import time
from typing import Any, NamedTuple, Self

from websockets.sync.client import connect
from websockets.typing import Subprotocol

MESSAGE, SERVICE_RESPONSE, SERVICE_REQUEST = 1, 3, 2


class Received(NamedTuple):
    """One message of a channel."""

    topic: str
    time_ns: int
    payload: bytes


class FoxgloveClient:
    """Connects, and subscribes to every channel it hears of, from `with` to its end."""

    def __init__(self, port: int) -> None:
        self._connection = connect(
            f"ws://127.0.0.1:{port}", subprotocols=[Subprotocol("foxglove.sdk.v1")], max_size=None, compression=None
        )
        self.channels: dict[str, dict[str, Any]] = {}
        self.services: dict[str, int] = {}
        self.answers: dict[int, Any] = {}
        self.failures: list[str] = []
        self._topics: list[str] = []
        self._numbers: dict[int, int] = {}  # of the subscription to each channel

    def receive(self, timeout_s: float) -> Received | None:
        """The next message of a channel; None when none comes in time."""
        deadline = time.monotonic() + timeout_s
        while (left_s := deadline - time.monotonic()) > 0:
            try:
                frame = self._socket.recv(left_s)
            except TimeoutError:
                return None
            if isinstance(frame, str):
                self._told(json.loads(frame))
            elif frame[0] == MESSAGE:
                number, time_ns = struct.unpack_from("<IQ", frame, 1)
                return Received(self._topics[number], time_ns, frame[13:])
            elif frame[0] == SERVICE_RESPONSE:
                _, call, length = struct.unpack_from("<III", frame, 1)
                self.answers[call] = json.loads(frame[13 + length :])
        return None

    def _told(self, said: dict[str, Any]) -> None:
        if said["op"] == "advertise":
            for channel in said["channels"]:
                self._numbers[channel["id"]] = len(self._topics)
                self._topics.append(channel["topic"])
                self.channels[channel["topic"]] = channel
                self._subscribe(channel["id"])
        elif said["op"] == "status" and (unknown := re.fullmatch(r"Unknown channel ID: (\d+)", said["message"])):
            self._subscribe(int(unknown[1]))  # foxglove-sdk 0.30 knows a channel only a moment after it has told of it
        elif said["op"] == "advertiseServices":
            self.services |= {one["name"]: one["id"] for one in said["services"]}
        elif said["op"] == "serviceCallFailure":
            self.failures.append(said["message"])

    def _subscribe(self, channel: int) -> None:
        wanted = [{"id": self._numbers[channel], "channelId": channel}]
        self._socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def call(self, service: str, request: dict[str, Any]) -> Any:
        """Call a service with JSON; its answer."""
        number, encoding = len(self.answers) + 1, b"json"
        head = struct.pack("<BIII", SERVICE_REQUEST, self.services[service], number, len(encoding))
        self._socket.send(head + encoding + json.dumps(request).encode())
        while number not in self.answers:
            self.receive(0.05)
        return self.answers[number]

    def __enter__(self) -> Self:
        self._socket = self._connection.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()
