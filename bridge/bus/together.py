"""Several subscriptions read as one: of a few devices, where a pattern would bring all of them over the network."""

import threading
from collections import Counter, deque
from collections.abc import Sequence

from bridge.bus.contract import Message, Subscription
from bridge.bus.inbox import Inbox

_CHUNK = 512
_WAIT_S, _TURN_S = 1.0, 0.005


class Together:
    """See contract.Subscription. Takes its subscriptions over: whoever closes it closes them."""

    def __init__(self, subscriptions: Sequence[Subscription], capacity: int = 65536) -> None:
        if not subscriptions:
            raise ValueError("nothing to read together; give one subscription or more")
        self._parts, self._inbox, self._capacity = tuple(subscriptions), Inbox(capacity), capacity
        self._turns, self._line = threading.Condition(), deque[object]()
        self._queues: tuple[Inbox | Subscription, ...] = (self._inbox, *self._parts)
        self._open = len(self._parts)
        self._lock = threading.Lock()
        for part in self._parts:
            threading.Thread(target=self._pump, args=(part,), name="read together", daemon=True).start()

    def _pump(self, part: Subscription) -> None:
        while not part.closed:
            if came := part.drain(min(_CHUNK, self._capacity), _WAIT_S):
                self._put(came, part)
        with self._lock:
            self._open -= 1
            if not self._open:
                self._inbox.close()

    def _put(self, came: list[Message], part: Subscription) -> None:
        """What there is no room for waits where it came, which is where the past has room of its own; one after the other."""
        turn = object()
        with self._turns:
            self._line.append(turn)
            while self._line[0] is not turn or self._inbox.waiting + len(came) > self._capacity:
                if self._inbox.closed or part.closed:
                    break
                self._turns.wait(_TURN_S if self._line[0] is turn else _WAIT_S)
            self._line.remove(turn)
            self._inbox.put(came)
            self._turns.notify_all()

    def receive(self, timeout_s: float) -> Message | None:
        """See contract.Subscription."""
        return self._inbox.receive(timeout_s)

    def drain(self, limit: int, timeout_s: float) -> list[Message]:
        """See contract.Subscription."""
        return self._inbox.drain(limit, timeout_s)

    def wake(self) -> None:
        """See contract.Subscription."""
        self._inbox.wake()

    @property
    def missed(self) -> int:
        """See contract.Subscription."""
        return self._inbox.missed + sum(part.missed for part in self._parts)

    @property
    def missed_by_key(self) -> dict[str, int]:
        """See contract.Subscription."""
        counts = (Counter(part.missed_by_key) for part in self._queues)
        return dict(sum(counts, Counter[str]()))

    @property
    def overflowed(self) -> int:
        """See contract.Subscription."""
        return self._inbox.overflowed + sum(part.overflowed for part in self._parts)

    @property
    def caught_up(self) -> bool:
        """See contract.Subscription."""
        return all(part.caught_up for part in self._parts)

    @property
    def waiting(self) -> int:
        """See contract.Subscription."""
        return sum(part.waiting for part in self._queues)

    @property
    def waited_s(self) -> float:
        """See contract.Subscription."""
        return max(part.waited_s for part in self._queues)

    @property
    def closed(self) -> bool:
        """See contract.Subscription."""
        return self._inbox.closed

    def close(self) -> None:
        """See contract.Subscription."""
        self._inbox.close()
        for part in self._parts:
            part.close()
