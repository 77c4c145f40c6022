"""Message quotas: each device's messages wait in their own queue, so a flooding device delays no other. Pure."""

from collections import deque
from collections.abc import Callable, Collection, Sequence

from bridge.bus.contract import Message

#: a message counts for at least so many bytes
_LEAST_BYTES = 1024
#: most messages and bytes of one device that may wait; a bridge caches fewer messages of a device
QUOTA, QUOTA_BYTES = 4096, 4096 * _LEAST_BYTES
#: most messages and bytes of one device in a round; more wait for the next round
SHARE, SHARE_BYTES = 32, 32 * _LEAST_BYTES
#: approximate messages in a round: an estimator speaks to the other estimators between two rounds
ROUND = 1024
#: messages of a device above its quota are counted under this name
FLOODED = "messages flooded"


class _Queue:
    """Waiting messages of one device, and their size in bytes."""

    def __init__(self) -> None:
        self.waiting: deque[Message] = deque()
        self._size = 0

    def put(self, message: Message) -> int:
        """Append a message; returns how many of the oldest were dropped for it."""
        self.waiting.append(message)
        self._size += _size(message)
        dropped = 0
        while self._size > QUOTA_BYTES:
            self._pop()
            dropped += 1
        return dropped

    def share(self) -> list[Message]:
        """Take the messages of one round, oldest first: at least one."""
        taken = [self._pop()]
        left = SHARE_BYTES - _size(taken[0])
        while self.waiting and (left := left - _size(self.waiting[0])) >= 0:
            taken.append(self._pop())
        return taken

    def _pop(self) -> Message:
        message = self.waiting.popleft()
        self._size -= _size(message)
        return message


class Quotas:
    """Fair queue of bus messages: each round of the run loop takes a limited amount of them from each bus key, in order.

    From each key, a round takes at most SHARE_BYTES bytes, or one message that is larger. Each message counts for at
    least 1024 bytes. After about ROUND messages in total, the remaining keys wait for the next round.
    For each key, at most QUOTA_BYTES bytes wait; beyond that the oldest messages are dropped.
    dropped(key, messages): called with the bus key and the number of messages dropped.
    """

    def __init__(self, dropped: Callable[[str, int], None]) -> None:
        self._dropped = dropped
        self._queues: dict[str, _Queue] = {}

    def __len__(self) -> int:
        return sum(len(queue.waiting) for queue in self._queues.values())

    def __contains__(self, key: object) -> bool:
        return key in self._queues

    def round(self, messages: Sequence[Message]) -> list[Message]:
        """Queue new messages; return those to process in this round, by the limits that the class describes."""
        if not self._queues and len({message.key for message in messages}) == len(messages) <= ROUND:
            return list(messages)  # one message of each key, as usual: nothing has to wait
        for message in messages:
            if (queue := self._queues.get(message.key)) is None:
                queue = self._queues[message.key] = _Queue()
            if dropped := queue.put(message):
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
        """Return the ids of the devices with waiting messages."""
        return {_device(key) for key in self._queues}

    def drop(self, devices: Collection[str]) -> None:
        """Discard all waiting messages of these devices, from any bridge."""
        self._queues = {key: queue for key, queue in self._queues.items() if _device(key) not in devices}


def _device(key: str) -> str:
    return key.rpartition("/")[2]


def _size(message: Message) -> int:
    return max(_LEAST_BYTES, len(message.payload))
