"""Whose turn it is: neither a device that floods the bus nor fifty that are calibrated at once keep the others waiting.

What all others sent is handled first; those set aside then get a little time in every round, one after the other. After a
restart, when all have something waiting, one device after the other is brought up to now: most are back sooner so. What one
device says keeps its order, so what comes of it is the same whenever its turn is.
"""

import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from itertools import chain

from bridge.bus.contract import Message

#: one of so many bytes counts as two messages, and so on; and so does one that takes so long when it is handled aside, s
LARGE, LONG_S = 2048, 5e-4
#: so many messages of a device are handled at once with those of the others; more of them wait
SHARE = 32
#: so many may wait, a bus's cache among them; of more the oldest are dropped
MOST = 4096
#: so many of those of one device are handled at once, as of a cache, and so many a second for ever: twice what a bridge sends.
#: Of who has used that up no more than a second's may wait
AT_ONCE, A_SECOND = 4096.0, 400.0
_REMEMBERED = 1024
#: messages of a device that sends too many are counted under this
FLOODED = "messages flooded"
#: for those that wait, s in every round; what was begun is ended
ASIDE_S = 0.002
#: and where nothing came that could be handled at once, or devices are brought up to now after a restart
ALONE_S = 0.01
#: or so much of the time that has passed since they had it last, at most: where rounds take long what waits would never be done
PART, PART_S = 0.25, 0.1
#: with so many waiting of all devices together, that may be handled now, nothing more is taken in
FULL = 16384

Take = Callable[[Sequence[Message]], None]


class Turns:
    """Rounds of messages in, handed on to `take` in the order that is fair.

    dropped is told of a key and how many of its messages went unread.
    """

    def __init__(
        self,
        take: Take,
        dropped: Callable[[str, int], None],
        clock: Callable[[], float] = time.monotonic,
        busy: Callable[[], float] = time.thread_time,
    ) -> None:
        self._take, self._dropped, self._clock, self._busy = take, dropped, clock, busy
        self._queues: dict[str, _Queue] = {}  # of those that wait or are slow
        self._slow: set[str] = set()
        # Of them: those that are brought up to now, the ones of which that comes before all else, and of which nothing came yet.
        self._past, self._soon, self._first = set[str](), dict[str, None](), set[str]()
        self._old = 0  # messages that wait under those
        self._allowed: dict[str, tuple[float, float]] = {}  # what is left to a key that waits, and when that was so
        self._came, self._came_before, self._second = Counter[str](), Counter[str](), 0
        self._ended = clock()  # the last round
        #: how many messages wait
        self.waiting = 0

    @property
    def full(self) -> bool:
        """Whether what waits should become less first.

        What does of the past keeps nobody from coming who is up to now, nor does what is not to be handled before its time.
        """
        if self.waiting - self._old < FULL:
            return False
        ready = (len(queue) for key, queue in self._queues.items() if key not in self._past and self._left(key) > 0)
        return sum(ready) >= FULL

    @property
    def pressing(self) -> bool:
        """Whether there is something to be done even if nothing more comes."""
        return self._next() is not None

    def waits(self, key: str) -> bool:
        """Whether messages of this key wait."""
        return bool(self._queues.get(key))

    def of_the_past(self, key: str) -> bool:
        """Whether what waits of this key began as its past; see behind."""
        return key in self._past

    def floods(self, key: str) -> bool:
        """Whether more came under this key than it may send, in this second so far or the one before."""
        return max(self._came_now()[key], self._came_before[key]) > A_SECOND

    def slow(self, key: str, *, now: bool) -> None:
        """Whether a message of this key may now take as long as a calibration does."""
        if now:
            self._slow.add(key)
            self._queues.setdefault(key, _Queue())
        else:
            self._slow.discard(key)

    def behind(self, key: str, *, soon: bool) -> None:
        """What comes now under this key is of the past: all but the first waits, and is handled at a stretch if it is soon done.

        The first is handled at once, so that it is known which devices there are, and that they are ours.
        """
        if key in self._past:
            return
        queue = self._queues.setdefault(key, _Queue())
        if not queue:  # else what comes next is not the first
            self._first.add(key)
        self._past.add(key)
        self._old += len(queue)
        if soon:
            self._soon[key] = None

    def withdraw(self, device: str) -> list[Message]:
        """What waits of a device that is ours no more."""
        found: list[Message] = []
        for key in [key for key in self._queues if key.rpartition("/")[2] == device]:
            found += (waited := self._queues.pop(key))
            self._slow.discard(key)
            self._count(key, -len(waited))
            self._caught_up(key)
        return found

    def round(self, messages: Sequence[Message]) -> None:
        """Handle what came, and some of what waits."""
        prompt = self._prompt(messages)
        self._take(prompt)
        began = self._clock()
        part_s = min(PART * (began - self._ended), PART_S)
        while (key := self._next()) is not None:
            queue, past = self._queues.pop(key), key in self._past
            part, counts = queue.share(one=key in self._slow)
            self._count(key, -len(part))
            if queue or key in self._slow:
                self._queues[key] = queue  # behind the others
            if not queue:
                self._caught_up(key)
            left, before = self._left(key), self._busy()
            self._take(part)
            if not past:
                counts = max(counts, min((self._busy() - before) / LONG_S, A_SECOND))
            self._allowed[key] = left - counts, self._clock()
            if len(self._allowed) > _REMEMBERED:
                self._allowed = {
                    k: one for k, one in self._allowed.items() if k in self._queues or self._left(k) < AT_ONCE
                }
            aside_s = ASIDE_S if key in self._slow or (prompt and not past) else ALONE_S
            if self._clock() >= began + max(part_s, aside_s):
                break
        self._ended = self._clock()

    def _next(self) -> str | None:
        if not self.waiting:
            return None
        return next((key for key in chain(self._soon, self._queues) if self._queues[key] and self._left(key) > 0), None)

    def _came_now(self) -> Counter[str]:
        """How many messages of each key came in this second."""
        second = int(self._clock())
        if second != self._second:
            self._came_before = self._came if second == self._second + 1 else Counter()
            self._came, self._second = Counter(), second
        return self._came

    def _left(self, key: str) -> float:
        """How many messages of a key may be handled now."""
        left, since = self._allowed.get(key, (AT_ONCE, 0.0))
        return min(AT_ONCE, left + (self._clock() - since) * A_SECOND)

    def _prompt(self, messages: Sequence[Message]) -> Sequence[Message]:
        keys = [key for key, _ in messages]
        keys += [key for key, payload in messages if len(payload) >= LARGE for _ in range(len(payload) // LARGE)]
        counts, came = Counter(keys), self._came_now()
        came.update(keys)
        often = max(map(came.__getitem__, counts), default=0) > A_SECOND
        if not often and not self._queues.keys() & counts.keys() and max(counts.values(), default=0) <= SHARE:
            return messages
        prompt, taken = [], Counter[str]()
        for message in messages:
            key = message.key
            if key in self._first:
                self._first.discard(key)
                prompt.append(message)
                continue
            if key not in self._queues and taken[key] < SHARE and came[key] <= A_SECOND:
                taken[key] += _counts(message)
                prompt.append(message)
                continue
            queue = self._queues.setdefault(key, _Queue())
            queue.put(message)
            self._count(key, 1)
            if over := queue.fit(self._room(key)):
                self._count(key, -over)
                self._dropped(key, over)
                if key in self._past:  # it goes on for longer than any past
                    self._old -= len(queue)
                    self._caught_up(key)
            elif len(queue) > MOST // 2 and key in self._past and key not in self._soon:
                self._soon = {key: None} | self._soon  # before any of it is dropped
        return prompt

    def _room(self, key: str) -> float:
        """As how many messages those may count that wait under a key; a bridge's cache of large ones, of its past."""
        if key in self._past:
            return 4 * MOST
        return MOST if self._left(key) > 0 else A_SECOND

    def _count(self, key: str, more: int) -> None:
        self.waiting += more
        if key in self._past:
            self._old += more

    def _caught_up(self, key: str) -> None:
        self._past.discard(key)
        self._soon.pop(key, None)
        self._first.discard(key)


def _counts(message: Message) -> int:
    """As how many messages one counts."""
    return 1 + len(message.payload) // LARGE


class _Queue:
    """Messages that wait, and as how many they count."""

    __slots__ = ("_messages", "counts")

    def __init__(self) -> None:
        self._messages: deque[Message] = deque()
        self.counts = 0

    def __len__(self) -> int:
        return len(self._messages)

    def __iter__(self) -> Iterator[Message]:
        return iter(self._messages)

    def put(self, message: Message) -> None:
        self._messages.append(message)
        self.counts += _counts(message)

    def next(self) -> Message:
        message = self._messages.popleft()
        self.counts -= _counts(message)
        return message

    def fit(self, most: float) -> int:
        """Drop the oldest until the rest counts as no more than so many; how many were dropped."""
        dropped = 0
        while self.counts > most and len(self._messages) > 1:
            self.next()
            dropped += 1
        return dropped

    def share(self, *, one: bool) -> tuple[list[Message], float]:
        """The next that may be handled before time is looked at again, and as how many they count."""
        counts, part = self.counts, [self.next()]
        while self._messages and not one and counts - self.counts + _counts(self._messages[0]) <= SHARE:
            part.append(self.next())
        return part, counts - self.counts
