"""A ward that says what a test wants it to say, in real messages over the bus in memory."""

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from bridge.bus.contract import Publisher
from bridge.bus.memory_bus import MemoryBroker, MemoryBus
from bridge.wire import codec, keys
from bridge.wire.messages import (
    Calibration,
    CommandReply,
    CorrectedBatch,
    DeviceInfo,
    Note,
    Quality,
    SampleBatch,
    State,
    Status,
)
from estimator.session import DeviceSession
from tests.estimator.stream import info

WARD = "w"


def said(device: str, state: State = State.TRACKING, **changes: Any) -> Status:
    """A status as an estimator would send it."""
    plain = replace(DeviceSession(device).status(7), quality=Quality.GOOD, reason="all is well", bias_std=(0.001,) * 3)
    return replace(plain, state=state, rate_hz=104.0, **changes)


def about(device: str, **changes: Any) -> DeviceInfo:
    """What a bridge would say of it."""
    return replace(info(), device=device, **changes)


class Talk:
    """Publishers of a bridge and an estimator, who are alive as long as it is open."""

    def __init__(self, broker: MemoryBroker) -> None:
        self._bus = MemoryBus(broker)
        self._publishers: dict[str, Publisher] = {}
        self._alive = [
            self._bus.declare_alive(keys.build(WARD, f"alive/{kind}", **{kind: "one"}))
            for kind in ("bridge", "estimator")
        ]
        self.asked: list[tuple[str, str, str, str]] = []
        self.answer: Callable[[str, str], CommandReply] = lambda verb, device: CommandReply(
            "", accepted=True, message=f"{verb} it is"
        )
        self._lock = threading.Lock()
        self._bus.answer(keys.pattern(WARD, "rpc"), self._on_command)

    def __call__(self, *messages: Status | DeviceInfo | Calibration | Note | SampleBatch | CorrectedBatch) -> None:
        """Say these."""
        for message in messages:
            what, encode = _KINDS[type(message)]
            ids = {"bridge": "bridge"} if what in ("info", "raw") else {}
            key = keys.build(WARD, what, **ids, device=message.device)
            if key not in self._publishers:
                self._publishers[key] = self._bus.publisher(key, cache=64)
            self._publishers[key].put(encode(message))

    def die(self) -> None:
        """Bridge and estimator are gone."""
        for token in self._alive:
            token.close()

    def _on_command(self, key: str, payload: bytes) -> bytes:
        place, command = keys.parse(key), codec.decode_command(key, payload)
        with self._lock:
            self.asked.append((place.device, place.ids["verb"], command.who, command.reason))
        return codec.encode_reply(replace(self.answer(place.ids["verb"], place.device), request_id=command.request_id))


_KINDS: dict[type, tuple[str, Callable[[Any], bytes]]] = {
    Status: ("status", codec.encode_status),
    DeviceInfo: ("info", codec.encode_info),
    Calibration: ("calibration", codec.encode_calibration),
    Note: ("note", codec.encode_note),
    SampleBatch: ("raw", codec.encode_samples),
    CorrectedBatch: ("corrected", codec.encode_corrected),
}
