"""A ward that says what a test wants it to say, in real messages over the bus in memory."""

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from bridge.bus.contract import Publisher, Reply
from bridge.wire import codec, keys
from bridge.wire.messages import (
    Calibration,
    CommandReply,
    CorrectedBatch,
    DeviceInfo,
    Note,
    OrientationBatch,
    Placement,
    Quality,
    SampleBatch,
    State,
    Status,
)
from estimator.device.session import DeviceSession
from tests.estimator.stream import info
from tests.memory_bus import MemoryBroker, MemoryBus
from tests.sentences import free

WARD = "w"
Message = Status | DeviceInfo | Calibration | Note | SampleBatch | CorrectedBatch | OrientationBatch


def said(device: str, state: State = State.TRACKING, **changes: Any) -> Status:
    """A status as an estimator would send it."""
    plain = replace(
        DeviceSession(device).status(7), quality=Quality.GOOD, reason=free("all is well"), bias_std=(0.001,) * 3
    )
    return replace(plain, state=state, **{"rate_hz": 104.0, **changes})


def about(device: str, **changes: Any) -> DeviceInfo:
    """What a bridge would say of it."""
    return replace(info(), device=device, **changes)


def until(met: Callable[[], object]) -> None:
    """Wait until it is so; the time limit of the test ends a wait in vain."""
    while not met():
        time.sleep(0.01)


class Talk:
    """Publishers of a bridge and an estimator, who are alive as long as it is open."""

    def __init__(self, broker: MemoryBroker) -> None:
        self._bus, self._lock = MemoryBus(broker), threading.Lock()
        self._publishers: dict[str, Publisher] = {}
        self._alive = [
            self._bus.declare_alive(keys.build(WARD, f"alive/{kind}", **{kind: "one"}))
            for kind in ("bridge", "estimator")
        ]
        self.asked: list[tuple[str, str, str, str]] = []
        self.placed: list[Placement] = []
        self.answer: Callable[[str, str], CommandReply] = lambda verb, device: CommandReply(
            "", accepted=True, message=free(f"{verb} it is")
        )
        self._bus.answer(keys.pattern(WARD, "rpc"), self._on_command)
        self._latest: dict[str, Status] = {}
        self._saying = threading.Lock()
        self._hush = threading.Event()
        self._thread = threading.Thread(target=self._again, daemon=True)
        self._thread.start()

    def __call__(self, *messages: Message) -> None:
        """Say these."""
        for message in messages:
            with self._saying:
                if isinstance(message, Status):
                    self._latest[message.device] = message
                self._put(message)

    def hush(self) -> None:
        """Nothing is said again."""
        self._hush.set()
        self._thread.join()

    def _again(self) -> None:
        """Statuses are said again and again, as an estimator does."""
        while not self._hush.wait(0.9):
            for device in list(self._latest):
                with self._saying:  # what is newer by then is not overtaken by what is old
                    self._put(replace(self._latest[device], time_ns=time.time_ns()))

    def _put(self, message: Message) -> None:
        with self._lock:
            what, encode = _KINDS[type(message)]
            ids = {"bridge": "bridge"} if what in ("info", "raw") else {}
            key = keys.build(WARD, what, **ids, device=message.device)
            if key not in self._publishers:
                self._publishers[key] = self._bus.publisher(key, cache=64)
            self._publishers[key].put(encode(message))

    def close(self) -> None:
        """Nobody answers any more."""
        self.hush()
        self._bus.close()

    def die(self) -> None:
        """Bridge and estimator are gone."""
        for token in self._alive:
            token.close()

    def _on_command(self, key: str, payload: bytes, reply: Reply) -> None:
        place, command = keys.parse(key), codec.decode_command(key, payload)
        with self._lock:
            self.asked.append((place.device, place.ids["verb"], command.who, command.reason))
            if command.placement is not None:
                self.placed.append(command.placement)
        said = self.answer(place.ids["verb"], place.device)
        reply(codec.encode_reply(replace(said, request_id=command.request_id)))


_KINDS: dict[type, tuple[str, Callable[[Any], bytes]]] = {
    Status: ("status", codec.encode_status),
    DeviceInfo: ("info", codec.encode_info),
    Calibration: ("calibration", codec.encode_calibration),
    Note: ("note", codec.encode_note),
    SampleBatch: ("raw", codec.encode_samples),
    CorrectedBatch: ("corrected", codec.encode_corrected),
    OrientationBatch: ("orientation", codec.encode_orientation),
}
