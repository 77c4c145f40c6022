"""The last that devices have sent, to go on from with those of other estimators: kept until it is corrected by them. Pure.

What an estimator says to have corrected is kept a little longer: its words and its corrected samples may go different ways, and
those that it had sent when it died may have got lost. Whoever hears a sample twice takes it once.

Of our own devices it is kept, too: another may have taken one long before we hear of it, and what we say meanwhile nobody
listens to. It is not lost where that one never comes to it and the device is ours again.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

from google.protobuf.message import DecodeError

from bridge.bus.contract import Message
from bridge.wire import columns_pb2 as columns

#: longer than it takes to notice that an estimator hangs; shorter than a bridge's cache, from which more would come
HELD_S = 12.0
OVERLAP_S = 0.5
#: what waits for less than this need not be known better
LITTLE_S = 1.0
#: of one device; bytes of all together, of which those of the device that has most go first
MOST, MOST_BYTES = 640, 64 * 2**20


@dataclass(slots=True)
class _Held:
    message: Message
    came_s: float
    says: tuple[int, int, int] | None = None  # boot, the number after its last sample, when the bridge had it

    def read(self) -> tuple[int, int, int]:
        if self.says is None:
            try:
                raw = columns.SampleBatch.FromString(self.message.payload)
                self.says = raw.boot, raw.sequence + len(raw.ticks) // 8, raw.receive_time_ns
            except (DecodeError, UnicodeDecodeError, RuntimeWarning):
                self.says = -1, 0, 0  # whoever has the device refuses it
        return self.says


@dataclass(slots=True)
class _Queue:
    held: deque[_Held] = field(default_factory=deque)
    size: int = 0
    epoch: int = 0
    #: how far who has it has come, boot and number; when that was said last, and since when it has not come any further
    reached: tuple[int, int] = -1, 0
    said_s: float = float("-inf")
    reached_s: float = float("-inf")
    #: what had come last then; None where what it said has been looked at
    newest: _Held | None = None

    def waits_s(self, now: float) -> float:
        return now - max(self.held[0].came_s, self.reached_s) if self.held else 0.0

    def drop(self) -> int:
        size = len(self.held.popleft().message.payload)
        self.size -= size
        return size

    def drop_done(self) -> int:
        """What who has it had done when it said so; the bytes that it took."""
        if self.newest is None:
            return 0
        boot, next_ = self.reached
        # What a bridge kept for us comes all at once, however old it is.
        last, recent_ns = -1, self.newest.read()[2] - round(OVERLAP_S * 1e9)
        self.newest = None
        for at, held in enumerate(self.held):
            its, reaches, had_ns = held.read()
            if held.came_s > self.said_s - OVERLAP_S and had_ns > recent_ns:
                break
            if its == boot and reaches > next_:
                break  # whatever comes after it
            if its == boot:
                last = at
        return sum(self.drop() for _ in range(last + 1))


class Standby:
    """Messages by device; `now` is monotonic seconds.

    What is said to be done, five times a second, is only noted, and goes once somebody asks for what is kept, or room is needed.
    """

    def __init__(self, devices: int) -> None:
        self._room = devices
        self._queues: dict[str, _Queue] = {}
        self._size = 0
        #: messages that were dropped although nobody is known to have corrected them, for want of room
        self.dropped = 0

    def __iter__(self) -> Iterator[str]:
        return iter(self._queues)

    def __contains__(self, device: str) -> bool:
        return device in self._queues

    def __len__(self) -> int:
        return len(self._queues)

    def hold(self, device: str, message: Message, now: float) -> bool:
        """Keep a message of another's device; whether it is the only one."""
        queue = self._queues.get(device)
        if queue is None:
            if len(self._queues) >= self._room:
                self.take(next(iter(self._queues)))
            queue = self._queues[device] = _Queue()
        queue.held.append(_Held(message, now))
        queue.size += len(message.payload)
        self._size += len(message.payload)
        while queue.held[0].came_s < now - HELD_S:
            self._size -= queue.drop()
        if len(queue.held) > MOST:
            self._drop_one(queue)
        while self._size > MOST_BYTES:
            fair = self._size / len(self._queues)
            self._drop_one(queue if queue.size >= fair else max(self._queues.values(), key=lambda q: q.size))
        return len(queue.held) <= 1

    def _drop_one(self, queue: _Queue) -> None:
        if not (done := queue.drop_done()):
            done, self.dropped = queue.drop(), self.dropped + 1
        self._size -= done

    def waits_s(self, device: str, now: float) -> float:
        """How long something of a device has been kept with which who has it does nothing, nor with what is before it."""
        if (queue := self._queues.get(device)) is None:
            return 0.0
        waits_s = queue.waits_s(now)
        if waits_s > LITTLE_S:  # it may be done: to look at all of them would hold up who takes devices over
            self._size -= queue.drop_done()
            waits_s = queue.waits_s(now)
        return waits_s

    def done(self, device: str, boot: int, next_: int, now: float, epoch: int = 0) -> None:
        """Who has a device since this epoch has corrected all of this boot below this number.

        To what is said under an earlier epoch than was heard of nobody listens, neither do we.
        """
        queue = self._queues.get(device)
        if queue is None or epoch < queue.epoch:
            return
        if epoch > queue.epoch or boot != queue.reached[0]:
            self._size -= queue.drop_done()
        queue.epoch = epoch
        if (boot, next_) != queue.reached:
            queue.reached, queue.reached_s = (boot, next_), now
        queue.said_s, queue.newest = now, queue.held[-1] if queue.held else None

    def take(self, device: str) -> list[Message]:
        """What is kept of a device, in the order in which it came; it is another's no more."""
        queue = self._queues.pop(device, None)
        if queue is None:
            return []
        self._size -= queue.size
        queue.drop_done()
        return [held.message for held in queue.held]

    def has(self, device: str, message: Message) -> bool:
        """Whether this very message is kept."""
        return device in self and any(held.message is message for held in self._queues[device].held)

    def move(self, device: str, to: "Standby", now: float) -> list[Message]:
        """What is kept of a device is kept there from now on; the messages, in the order in which they came."""
        queue = self._queues.get(device)
        if queue is not None:
            self._size -= queue.drop_done()
        for held in () if queue is None else queue.held:
            to.hold(device, held.message, held.came_s)
        to.wait_anew(device, now)
        return self.take(device)

    def wait_anew(self, device: str, now: float) -> None:
        """Somebody else has it from now on: that one has done nothing with it yet."""
        if (queue := self._queues.get(device)) is not None:
            queue.reached_s = now

    def tidy(self, now: float) -> None:
        """Forget what is done or too old, and devices that send nothing."""
        for device, queue in list(self._queues.items()):
            self._size -= queue.drop_done()
            while queue.held and queue.held[0].came_s < now - HELD_S:
                self._size -= queue.drop()
            if not queue.held:
                del self._queues[device]
