"""Logs for replays: sample messages kept for a takeover, and the last samples corrected before a restart. Pure."""

from collections import Counter, deque
from collections.abc import Collection, Mapping, Sequence
from itertools import takewhile

from google.protobuf.message import DecodeError

from bridge.bus.contract import Message
from bridge.wire import columns_pb2 as columns
from estimator.samples.sample_buffer import Samples

#: how long messages are kept, s: more than the age of a checkpoint plus the time to notice a dead estimator
REPLAY_S = 10.0
#: most samples merged into one message of a backlog
MERGED = 512
#: most bytes of all messages, and of one device's, so that a flooding device leaves room for others
REPLAY_BYTES, DEVICE_BYTES = 64 * 2**20, 4 * 2**20
#: samples corrected before the restart are counted under this name
DONE = "samples corrected before the restart"
#: how long replayed samples may arrive after a restart, s: more than a bridge's cache holds and takes to arrive
LASTS_S = 60.0
#: span published again, s: a network cut may have lasted this long before it was noticed
OVERLAP_S = 5.0

#: progress of a device: boot, sequence number and host time, ns, of its last correction; and its bridge
Reached = tuple[int, int, int, str]


class ReplayLog:
    """Log of all devices' sample messages of the last REPLAY_S seconds, for a takeover."""

    def __init__(self) -> None:
        self._order: deque[tuple[float, str]] = deque()  # arrival time and device of each message
        self._kept: dict[str, deque[Message]] = {}
        self._sizes = Counter[str]()
        self._size = 0

    def add(self, device: str, message: Message, now: float) -> None:
        """Keep a message received at `now`, monotonic s, unless its device has used up DEVICE_BYTES."""
        size = len(message.payload)
        if self._sizes[device] + size > DEVICE_BYTES:
            return
        self._order.append((now, device))
        self._kept.setdefault(device, deque()).append(message)
        self._sizes[device] += size
        self._size += size
        self.tidy(now)

    def tidy(self, now: float) -> None:
        """Drop messages older than REPLAY_S seconds at `now`, monotonic s, or beyond REPLAY_BYTES in total."""
        order = self._order
        while order and (order[0][0] < now - REPLAY_S or self._size > REPLAY_BYTES):
            _, device = order.popleft()
            size = len(self._kept[device].popleft().payload)
            self._size -= size
            self._sizes[device] -= size
            if not self._kept[device]:
                del self._kept[device], self._sizes[device]

    def forget(self, device: str) -> None:
        """Drop all kept messages of a device."""
        self._order = deque(entry for entry in self._order if entry[1] != device)
        self._kept.pop(device, None)
        self._size -= self._sizes.pop(device, 0)

    def heard(self, device: str, since: float) -> bool:
        """Return whether a kept message of a device came after the time `since`, monotonic s."""
        late = takewhile(lambda entry: entry[0] > since, reversed(self._order))
        return any(name == device for _, name in late)

    def devices(self) -> set[str]:
        """Ids of the devices with kept messages."""
        return set(self._kept)

    def of(self, devices: Collection[str]) -> dict[str, list[Message]]:
        """Return the kept messages of these devices, by device, in order of arrival."""
        return {device: list(self._kept.get(device, ())) for device in devices}


class Resumed:
    """Recogniser of replayed samples that this estimator had corrected already before it was restarted.

    reached: by device, the last sample corrected before the restart: boot id, sequence number, host time (ns since the
    Unix epoch) and bridge id. now: monotonic time of the restart, s.
    """

    def __init__(self, reached: Mapping[str, Reached], now: float) -> None:
        self._reached, self._until = dict(reached), now + LASTS_S

    def lasts(self, now: float) -> bool:
        """Return whether replayed samples may still arrive at `now`, monotonic s: within LASTS_S of the restart."""
        if self._reached and now >= self._until:
            self._reached = {}
        return bool(self._reached)

    def done(self, samples: Samples) -> bool:
        """Return whether samples were corrected before the restart, by boot, sequence number and host time.

        False for samples of another run under the same boot number: their host time is later.
        """
        boot, following, time_ns, _ = self._reached.get(samples.device, (-1, 0, 0, ""))
        before = samples.receive_time_ns < time_ns - OVERLAP_S * 1e9
        return samples.boot == boot and samples.sequence + samples.n <= following and before

    def bridge(self, device: str, came_ns: int) -> str:
        """Return the id of the bridge whose samples of a device were used before the restart.

        came_ns: host time of a sample's receipt, ns since the Unix epoch. The id is empty if the bridge is unknown, or
        if the sample came after the last one corrected before the restart.
        """
        found = self._reached.get(device)
        return "" if found is None or came_ns > found[2] else found[3]


def since(messages: Sequence[Message], boot: int, following: int) -> list[Message]:
    """Select the messages that a session has not processed yet.

    messages: in order of arrival. boot: id of the session's boot. following: number of the first sample that the
    session has not processed.
    A message of this boot is selected if it contains samples from `following` on. All messages that arrived after the
    last processed one are selected, too.
    Consecutive messages are merged into few large ones.
    """
    left = [(message, _read(message)) for message in messages]
    ends = {n: _end(raw) for n, (_, raw) in enumerate(left) if raw is not None and raw.boot == boot}
    last = max((n for n, end in ends.items() if end <= following), default=-1)
    # A second bridge may repeat the first one's samples later, so new samples before the repeat are kept.
    return _merged([one for n, one in enumerate(left) if n > last or ends.get(n, 0) > following])


_Left = tuple[Message, columns.SampleBatch | None]


def _read(message: Message) -> columns.SampleBatch | None:
    try:
        return columns.SampleBatch.FromString(message.payload)
    except (DecodeError, UnicodeDecodeError, RuntimeWarning):
        return None  # refused and counted by the decoder


def _end(raw: columns.SampleBatch) -> int:
    return raw.sequence + len(raw.ticks) // 8


def _merged(left: Sequence[_Left]) -> list[Message]:
    """Merge consecutive messages into one, since a message costs as much as a hundred samples."""
    groups = list[tuple[Message, list[columns.SampleBatch]]]()
    kind, end = None, 0  # of the message before
    for message, raw in left:
        before, kind = kind, None if raw is None else _kind(message.key, raw)
        if raw is None or kind != before or raw.sequence != end or _end(raw) - groups[-1][1][0].sequence > MERGED:
            groups.append((message, []))
        if raw is not None:
            groups[-1][1].append(raw)
            end = _end(raw)
    return [Message(one.key, _one(raws).SerializeToString()) if len(raws) > 1 else one for one, raws in groups]


def _kind(key: str, raw: columns.SampleBatch) -> tuple[object, ...]:
    """Properties that must be equal in messages to be merged."""
    columns_ = bool(raw.accel), bool(raw.temperature_c), bool(raw.flags)
    return key, raw.version, raw.device, raw.boot, raw.tick_period_s, columns_


def _one(group: Sequence[columns.SampleBatch]) -> columns.SampleBatch:
    one = columns.SampleBatch()
    one.CopyFrom(group[0])
    one.receive_time_ns = group[-1].receive_time_ns
    for name in ("ticks", "gyro", "accel", "temperature_c", "flags"):
        setattr(one, name, b"".join(getattr(raw, name) for raw in group))
    return one
