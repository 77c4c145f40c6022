"""Samples that are received again: the backlog of a device that is taken over, and what was corrected before a restart. Pure."""

from collections import deque
from collections.abc import Collection, Mapping, Sequence

from google.protobuf.message import DecodeError

from bridge.bus.contract import Message
from bridge.wire import columns_pb2 as columns
from estimator.device.samples import Samples

#: longer than a checkpoint is old plus the time in which a dead estimator is noticed, s
REPLAY_S = 10.0
#: samples of one message of a backlog
MERGED = 512
#: bytes of all messages
REPLAY_BYTES = 64 * 2**20
#: samples corrected before the restart are counted under this name
DONE = "samples corrected before the restart"
#: longer than a bridge's cache goes back, and than it takes to come, s
LASTS_S = 60.0
#: the last seconds are published again: a line may have been dead for so long before that was noticed, s
OVERLAP_S = 5.0

#: of a device: boot, sequence number and host time, ns, up to which it was corrected; the bridge that it was heard from
Reached = tuple[int, int, int, str]


class ReplayLog:
    """The last messages of all devices, with their devices, in the order in which they came; `now` is monotonic seconds."""

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


class Resumed:
    """Knows how far each device was; `now` is monotonic seconds."""

    def __init__(self, reached: Mapping[str, Reached], now: float) -> None:
        self._reached, self._until = dict(reached), now + LASTS_S

    def lasts(self, now: float) -> bool:
        """Whether any may still come."""
        if self._reached and now >= self._until:
            self._reached = {}
        return bool(self._reached)

    def done(self, samples: Samples) -> bool:
        """Whether samples were corrected before the restart; another run under the same boot number was not."""
        boot, following, time_ns, _ = self._reached.get(samples.device, (-1, 0, 0, ""))
        before = samples.receive_time_ns < time_ns - OVERLAP_S * 1e9
        return samples.boot == boot and samples.sequence + samples.n <= following and before

    def bridge(self, device: str, came_ns: int) -> str:
        """The bridge that a device was heard from before the restart, for samples received before it; empty where unknown."""
        found = self._reached.get(device)
        return "" if found is None or came_ns > found[2] else found[3]


def since(messages: Sequence[Message], boot: int, following: int) -> list[Message]:
    """What is left to be corrected of a device whose session has come to this number of a boot, in few large messages."""
    left = [(message, _read(message)) for message in messages]
    ends = [n for n, (_, raw) in enumerate(left) if raw is not None and raw.boot == boot and _end(raw) <= following]
    return _merged(left[ends[-1] + 1 :] if ends else left)


_Left = tuple[Message, columns.SampleBatch | None]


def _read(message: Message) -> columns.SampleBatch | None:
    try:
        return columns.SampleBatch.FromString(message.payload)
    except (DecodeError, UnicodeDecodeError, RuntimeWarning):
        return None  # refused at the door, and counted


def _end(raw: columns.SampleBatch) -> int:
    return raw.sequence + len(raw.ticks) // 8


def _merged(left: Sequence[_Left]) -> list[Message]:
    """Messages that go on where the one before ended, as one: a message costs as much as a hundred samples."""
    merged: list[Message] = []
    group: list[columns.SampleBatch] = []
    for message, raw in (*left, (None, None)):
        if group and (raw is None or message is None or message.key != merged[-1].key or not _goes_on(group, raw)):
            if len(group) > 1:
                merged[-1] = Message(merged[-1].key, _one(group).SerializeToString())
            group = []
        if message is not None:
            if not group:
                merged.append(message)
            if raw is not None:
                group.append(raw)
    return merged


def _goes_on(group: Sequence[columns.SampleBatch], raw: columns.SampleBatch) -> bool:
    first, last = group[0], group[-1]
    alike = (raw.version, raw.device, raw.boot, raw.tick_period_s) == (
        first.version,
        first.device,
        first.boot,
        first.tick_period_s,
    )
    columns_alike = all(
        bool(getattr(raw, name)) == bool(getattr(first, name)) for name in ("accel", "temperature_c", "flags")
    )
    return alike and columns_alike and raw.sequence == _end(last) and _end(raw) - first.sequence <= MERGED


def _one(group: Sequence[columns.SampleBatch]) -> columns.SampleBatch:
    one = columns.SampleBatch()
    one.CopyFrom(group[0])
    one.receive_time_ns = group[-1].receive_time_ns
    for name in ("ticks", "gyro", "accel", "temperature_c", "flags"):
        setattr(one, name, b"".join(getattr(raw, name) for raw in group))
    return one
