"""Replayed samples: the backlog of a device taken over, and samples corrected before a restart. Pure."""

from collections import Counter, deque
from collections.abc import Collection, Mapping
from itertools import takewhile

from bridge.bus.contract import Message
from estimator.samples.sample_buffer import Samples

#: how long messages are kept, s: more than the age of a checkpoint plus the time to notice a dead estimator
REPLAY_S = 10.0
#: most bytes of all messages, and of one device's, so that a flooding device leaves room for others
REPLAY_BYTES, DEVICE_BYTES = 64 * 2**20, 4 * 2**20
#: samples corrected before a restart or a takeover are counted under this name
DONE = "samples corrected before"
#: how long replayed samples may arrive after a restart, s: more than a bridge's cache holds and takes to arrive
LASTS_S = 60.0
#: span published again after a restart, ns: a network cut may have lasted this long before it was noticed
OVERLAP_NS = 5_000_000_000

#: progress of a device: boot, number after the last sample corrected, host time of that, ns, and its bridge
Reached = tuple[int, int, int, str]


class ReplayLog:
    """Recent messages of all devices, in order of arrival; `now` is monotonic seconds."""

    def __init__(self) -> None:
        self._order: deque[tuple[float, str]] = deque()  # arrival time and device of each message
        self._kept: dict[str, deque[Message]] = {}
        self._sizes = Counter[str]()
        self._size = 0

    def add(self, device: str, message: Message, now: float) -> None:
        """Keep a message, unless its device has used up its share already."""
        size = len(message.payload)
        if self._sizes[device] + size > DEVICE_BYTES:
            return
        self._order.append((now, device))
        self._kept.setdefault(device, deque()).append(message)
        self._sizes[device] += size
        self._size += size
        self.tidy(now)

    def tidy(self, now: float) -> None:
        """Drop messages that are too old or exceed the size limit, oldest first."""
        order = self._order
        while order and (order[0][0] < now - REPLAY_S or self._size > REPLAY_BYTES):
            _, device = order.popleft()
            size = len(self._kept[device].popleft().payload)
            self._size -= size
            self._sizes[device] -= size
            if not self._kept[device]:
                del self._kept[device], self._sizes[device]

    def forget(self, device: str) -> None:
        """Drop the messages of a device."""
        self._order = deque(entry for entry in self._order if entry[1] != device)
        self._kept.pop(device, None)
        self._size -= self._sizes.pop(device, 0)

    def heard(self, device: str, since: float) -> bool:
        """Whether a message of a device came after a time."""
        late = takewhile(lambda entry: entry[0] > since, reversed(self._order))
        return any(name == device for _, name in late)

    def devices(self) -> set[str]:
        """Devices with kept messages."""
        return set(self._kept)

    def of(self, devices: Collection[str]) -> dict[str, list[Message]]:
        """Kept messages of some devices, each device's in order."""
        return {device: list(self._kept.get(device, ())) for device in devices}


class Resumed:
    """Samples that were corrected before a restart or a takeover, and are replayed; `now` is monotonic seconds."""

    def __init__(self, reached: Mapping[str, Reached], now: float) -> None:
        self._reached, self._until = dict(reached), now + LASTS_S

    def lasts(self, now: float) -> bool:
        """Whether replayed samples may still arrive."""
        if self._reached and now >= self._until:
            self._reached = {}
        return bool(self._reached)

    def taken(self, device: str, boot: int, following: int, heard_ns: int, now: float) -> None:
        """Note that a device, heard last at host time heard_ns, goes on from its checkpoint at number `following`."""
        self._reached[device], self._until = (boot, following, heard_ns + OVERLAP_NS, ""), now + LASTS_S

    def done(self, samples: Samples) -> bool:
        """Whether samples were corrected before; another run under the same boot number was not."""
        boot, following, time_ns, _ = self._reached.get(samples.device, (-1, 0, 0, ""))
        before = samples.receive_time_ns <= time_ns - OVERLAP_NS
        return samples.boot == boot and samples.sequence + samples.n <= following and before

    def bridge(self, device: str, came_ns: int) -> str:
        """Bridge a device was heard from before the restart, for samples received before it; empty where unknown."""
        found = self._reached.get(device)
        return "" if found is None or came_ns > found[2] else found[3]
