"""Replay log: the last messages of all devices, from which a device that is taken over is brought up to now. Pure."""

from collections import deque
from collections.abc import Collection, Sequence

from google.protobuf.message import DecodeError

from bridge.bus.contract import Message
from bridge.wire import columns_pb2 as columns

#: longer than a checkpoint is old plus the time in which a dead estimator is noticed, s
REPLAY_S = 10.0
#: bytes of all messages
REPLAY_BYTES = 64 * 2**20


class ReplayLog:
    """Messages with their devices, in the order in which they came; `now` is monotonic seconds."""

    def __init__(self) -> None:
        self._kept: deque[tuple[float, str, Message]] = deque()
        self._size = 0

    def add(self, device: str, message: Message, now: float) -> None:
        """Keep a message."""
        self._kept.append((now, device, message))
        self._size += len(message.payload)
        self.tidy(now)

    def tidy(self, now: float) -> None:
        """Forget what is too old or too much, oldest first."""
        kept = self._kept
        while kept and (kept[0][0] < now - REPLAY_S or self._size > REPLAY_BYTES):
            self._size -= len(kept.popleft()[2].payload)

    def devices(self) -> set[str]:
        """Devices of which anything is kept."""
        return {device for _, device, _ in self._kept}

    def of(self, devices: Collection[str]) -> dict[str, list[Message]]:
        """The messages of some devices, each in its order."""
        found: dict[str, list[Message]] = {device: [] for device in devices}
        for _, device, message in self._kept:
            if device in found:
                found[device].append(message)
        return found


def since(messages: Sequence[Message], boot: int, following: int) -> Sequence[Message]:
    """The messages after the last one of a boot that ends below a sequence number: the others are corrected already."""
    for at in range(len(messages) - 1, -1, -1):
        try:
            raw = columns.SampleBatch.FromString(messages[at].payload)
        except (DecodeError, UnicodeDecodeError, RuntimeWarning):
            continue  # refused at the door, and counted
        if raw.boot == boot and raw.sequence + len(raw.ticks) // 8 <= following:
            return messages[at + 1 :]
    return messages
