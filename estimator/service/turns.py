"""Whose turn it is: neither a device that floods the bus nor fifty that are calibrated at once keep the others waiting.

What all others sent is handled first; those set aside then get a little time in every round, one after the other. What one
device says keeps its order, so what comes of it is the same whenever its turn is.
"""

import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from operator import itemgetter

from bridge.bus.contract import Message

#: so many messages of a device are handled at once with those of the others; more of them wait
SHARE = 32
#: so many may wait, a bus's cache among them; of more the oldest are dropped
MOST = 2048
#: so many of those of one device are handled in a second: a whole cache at once, but no flood for ever
A_SECOND = 2048
#: for those that wait, s in every round; what was begun is ended
ASIDE_S = 0.002
#: with so many waiting of all devices together nothing more is taken in
FULL = 16384

Take = Callable[[Sequence[Message]], None]


class Turns:
    """Rounds of messages in, handed on to `take` in the order that is fair.

    dropped is told of a key and how many of its messages went unread.
    """

    def __init__(
        self, take: Take, dropped: Callable[[str, int], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._take, self._dropped, self._clock = take, dropped, clock
        self._queues: dict[str, deque[Message]] = {}  # of those that wait or are slow
        self._slow: set[str] = set()
        self._spent, self._second = Counter[str](), 0
        #: how many messages wait
        self.waiting = 0

    @property
    def full(self) -> bool:
        """Whether what waits should become less first."""
        return self.waiting >= FULL

    @property
    def pressing(self) -> bool:
        """Whether there is something to be done even if nothing more comes."""
        return self._next() is not None

    def slow(self, key: str, *, now: bool) -> None:
        """Whether a message of this key may now take as long as a calibration does."""
        if now:
            self._slow.add(key)
            self._queues.setdefault(key, deque())
        else:
            self._slow.discard(key)

    def round(self, messages: Sequence[Message]) -> None:
        """Handle what came, and some of what waits."""
        self._take(self._prompt(messages))
        until = self._clock() + ASIDE_S
        while (key := self._next()) is not None:
            queue = self._queues.pop(key)
            # What is slow is handled one by one, so that time is looked at after each.
            part = [queue.popleft() for _ in range(1 if key in self._slow else min(SHARE, len(queue)))]
            self.waiting -= len(part)
            self._spent[key] += len(part)
            if queue or key in self._slow:
                self._queues[key] = queue  # behind the others
            self._take(part)
            if self._clock() >= until:
                return

    def _next(self) -> str | None:
        if not self.waiting:
            return None
        second = int(self._clock())
        if second != self._second:
            self._second = second
            self._spent.clear()
        return next((key for key, queue in self._queues.items() if queue and self._spent[key] < A_SECOND), None)

    def _prompt(self, messages: Sequence[Message]) -> Sequence[Message]:
        if not self._queues and len(messages) <= SHARE:
            return messages
        counts = Counter(map(itemgetter(0), messages))
        if not self._queues.keys() & counts.keys() and max(counts.values(), default=0) <= SHARE:
            return messages
        prompt, taken = [], Counter[str]()
        for message in messages:
            key = message.key
            if key not in self._queues and taken[key] < SHARE:
                taken[key] += 1
                prompt.append(message)
                continue
            queue = self._queues.setdefault(key, deque())
            queue.append(message)
            self.waiting += 1
            if len(queue) > MOST:
                queue.popleft()
                self.waiting -= 1
                self._dropped(key, 1)
        return prompt
