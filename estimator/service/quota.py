"""Quotas: each device's messages wait in their own queue, so that a flooding device delays no other. Pure."""

import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Sequence

from bridge.bus.contract import Message

#: most messages and bytes of one device that may wait; a bridge caches fewer messages of a device
QUOTA, QUOTA_BYTES = 4096, 4 * 2**20
#: most messages and bytes of one device in a round; more wait for the next round
SHARE, SHARE_BYTES = 32, 32 * 2**10
#: approximate messages in a round: an estimator speaks to the other estimators between two rounds
ROUND = 1024
#: messages of a device above its quota are counted under this name
FLOODED = "messages flooded"


class _Queue:
    """Waiting messages of one device, each with its arrival time in s."""

    def __init__(self) -> None:
        self.waiting: deque[tuple[float, Message]] = deque()
        self.size = 0

    def put(self, message: Message, now: float) -> int:
        """Append a message; returns how many of the oldest were dropped for it."""
        self.waiting.append((now, message))
        self.size += len(message.payload)
        dropped = 0
        while len(self.waiting) > QUOTA or self.size > QUOTA_BYTES:
            self.pop()
            dropped += 1
        return dropped

    def pop(self) -> Message:
        """Take the oldest message."""
        _, message = self.waiting.popleft()
        self.size -= len(message.payload)
        return message

    def share(self) -> list[Message]:
        """Take the messages of one round, oldest first: at least one."""
        taken = [self.pop()]
        left = SHARE_BYTES - len(taken[0].payload)
        while self.waiting and len(taken) < SHARE and (left := left - len(self.waiting[0][1].payload)) >= 0:
            taken.append(self.pop())
        return taken


class Quotas:
    """Fair queue of messages by key, emptied in rounds; each key keeps its order.

    dropped(key, messages) is called with the number of messages that exceeded the quota of a key.
    """

    def __init__(self, dropped: Callable[[str, int], None], clock: Callable[[], float] = time.monotonic) -> None:
        self._dropped, self._clock = dropped, clock
        self._queues: dict[str, _Queue] = {}

    def __len__(self) -> int:
        return sum(len(queue.waiting) for queue in self._queues.values())

    def __contains__(self, key: object) -> bool:
        return key in self._queues

    def typical_wait_s(self, devices: int) -> float:
        """Waiting time of the median device's oldest message, s. The median, as one flooding device is no overload."""
        waits = sorted((self._clock() - queue.waiting[0][0] for queue in self._queues.values()), reverse=True)
        return waits[devices // 2] if len(waits) > devices // 2 else 0.0

    def round(self, messages: Sequence[Message]) -> list[Message]:
        """Queue messages; returns the messages of this round, at most one share of each key."""
        if not self._queues and _ordinary(messages):
            return list(messages)
        now = self._clock()
        for message in messages:
            if (queue := self._queues.get(message.key)) is None:
                queue = self._queues[message.key] = _Queue()
            if dropped := queue.put(message, now):
                self._dropped(message.key, dropped)
        taken = list[Message]()
        for key in list(self._queues):
            if len(taken) >= ROUND:
                break
            queue = self._queues.pop(key)  # moves to the end: the next round begins with the keys after it
            taken += queue.share()
            if queue.waiting:
                self._queues[key] = queue
        return taken

    def devices(self) -> set[str]:
        """Devices with waiting messages."""
        return {_device(key) for key in self._queues}

    def drop(self, devices: Collection[str]) -> None:
        """Discard all messages of some devices, from any bridge."""
        self._queues = {key: queue for key, queue in self._queues.items() if _device(key) not in devices}


def _device(key: str) -> str:
    return key.rpartition("/")[2]


def _ordinary(messages: Sequence[Message]) -> bool:
    """Whether all messages fit in one round: no key exceeds its share, and no message is large."""
    if len(messages) > ROUND:
        return False
    if len(messages) > SHARE and max(Counter(message.key for message in messages).values()) > SHARE:
        return False
    return all(len(message.payload) <= SHARE_BYTES // SHARE for message in messages)
