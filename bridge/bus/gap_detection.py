"""Gap detection by message numbers: delivers the messages of each publisher in order and exactly once. No I/O.

Reports which missing messages to fetch from publishers' caches. All times are seconds of a monotonic clock.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Generic, NamedTuple, TypeVar

from bridge.bus.publisher_cache import Source

_T = TypeVar("_T")

#: pause before the next query about a gap, s; doubles with each try, up to the second value
PAUSE_S, LONGEST_PAUSE_S = 0.05, 4.0
#: a gap that no cache can fill is given up after this time, s, about the reach of a bridge's cache
PATIENCE_S = 30.0
#: largest number of messages waiting behind gaps, over all publishers
MOST_HELD = 1 << 16
#: largest number of publishers remembered: a malicious publisher can invent any number of identities
MOST_SOURCES = 1 << 16


class Gap(NamedTuple):
    """Gap in a publisher's message numbers. source: the publisher. start: number of the first missing message."""

    source: Source
    start: int


@dataclass(slots=True)
class _State(Generic[_T]):
    #: number of the next message to deliver, and the highest number known to have been sent
    next: int = 0
    newest: int = -1
    #: whether a message was delivered; earlier messages are history, and never count as missed
    begun: bool = False
    held: dict[int, _T] = field(default_factory=dict)
    #: time of the last progress, time of the next query, queries without progress, and whether a query is pending
    since_s: float = 0.0
    due_s: float = 0.0
    tries: int = 0
    asked: bool = False


class GapDetector(Generic[_T]):
    """Puts numbered messages of many publishers in order and tracks the missing numbers of each publisher.

    Each publisher numbers its messages from 0. Methods that return messages return those that can be delivered now, in
    the order of their numbers. missed: number of messages lost for good, by key.
    """

    def __init__(self) -> None:
        self._states: dict[Source, _State[_T]] = {}
        self._lacking: dict[Source, _State[_T]] = {}
        self._held = 0
        #: messages lost for good, by key
        self.missed: Counter[str] = Counter()

    def take(self, source: Source, number: int, message: _T, now_s: float) -> Sequence[_T]:
        """Add one live message with its number; return the messages to deliver now.

        A repeated message is dropped. A message waits while earlier numbers are missing. source: the publisher.
        number: the publisher's number of the message. now_s: seconds of a monotonic clock.
        """
        state = self._state(source)
        if number < state.next:
            return ()
        if number == state.next and not state.held:
            state.next, state.begun = number + 1, True
            if source in self._lacking:
                self._review(source, state, now_s)
            return (message,)
        self._hold(state, {number: message})
        ready = self._settle(source, state, state.newest) if self._held > MOST_HELD else self._run(state)
        self._review(source, state, now_s)
        return ready

    def heard(self, source: Source, number: int, now_s: float) -> None:
        """Add the number of a publisher's newest message, as its cache reports it, to detect that the last message was lost.

        source: the publisher. now_s: seconds of a monotonic clock.
        """
        state = self._state(source)
        state.newest = max(state.newest, number)
        self._review(source, state, now_s)

    def history(self, source: Source, found: Mapping[int, _T], now_s: float) -> Sequence[_T]:
        """Add messages that a publisher sent before the subscription began; return the messages to deliver now.

        source: the publisher. found: messages from its cache, by message number. now_s: seconds of a monotonic clock.
        """
        state = self._state(source)
        ready = self._fill(source, state, found)
        self._review(source, state, now_s)
        return ready

    def due(self, now_s: float, most: int = 64) -> list[Gap]:
        """Return up to `most` gaps for which publishers' caches should be queried now.

        The caller must report the answer to each gap by `answered`. now_s: seconds of a monotonic clock.
        """
        gaps = list[Gap]()
        for source, state in self._lacking.items():
            if not state.asked and state.due_s <= now_s and len(gaps) < most:
                state.asked = True
                gaps.append(Gap(source, state.next))
        return gaps

    def answered(self, source: Source, found: Mapping[int, _T], now_s: float) -> Sequence[_T]:
        """Add the answer of a publisher's cache to the query about a gap; return the messages to deliver now.

        source: the publisher. found: cached messages by message number; empty if the publisher was unreachable. An
        unreachable publisher is queried again after a pause. After PATIENCE_S (30) seconds without progress, the
        missing messages count as missed. now_s: seconds of a monotonic clock.
        """
        state, before = self._state(source), self._state(source).next
        ready = self._fill(source, state, found)
        state.asked = False
        if state.next > before:
            state.tries, state.since_s = 0, now_s
        elif now_s - state.since_s >= PATIENCE_S:
            ready += self._settle(source, state, state.newest)
            state.newest = state.next - 1
        state.due_s = now_s + min(PAUSE_S * 2**state.tries, LONGEST_PAUSE_S)
        state.tries += 1
        self._review(source, state, now_s)
        return ready

    def _state(self, source: Source) -> _State[_T]:
        state = self._states.get(source)
        if state is None:
            while len(self._states) >= MOST_SOURCES:
                oldest = next(iter(self._states))
                self._held -= len(self._states.pop(oldest).held)
                self._lacking.pop(oldest, None)
            state = self._states[source] = _State()
        elif len(self._states) > MOST_SOURCES // 2:  # keep active publishers longer than invented ones
            self._states[source] = self._states.pop(source)
        return state

    def _hold(self, state: _State[_T], found: Mapping[int, _T]) -> None:
        before = len(state.held)
        state.held.update((number, message) for number, message in found.items() if number >= state.next)
        self._held += len(state.held) - before
        state.newest = max(state.newest, *found)

    def _fill(self, source: Source, state: _State[_T], found: Mapping[int, _T]) -> list[_T]:
        """Deliver a cache's messages and their successors; a message missing in the answer is lost."""
        if not found:
            return []
        self._hold(state, found)
        return self._settle(source, state, max(found))

    def _settle(self, source: Source, state: _State[_T], last: int) -> list[_T]:
        """Deliver held messages up to number `last`, and count the gaps between as missed."""
        ready: list[_T] = []
        for number in sorted(number for number in state.held if number <= last):
            if number in state.held:
                if state.begun and number > state.next:
                    self.missed[source.key] += number - state.next
                state.next = number
                ready += self._run(state)
        return ready

    def _run(self, state: _State[_T]) -> list[_T]:
        ready: list[_T] = []
        while state.next in state.held:
            ready.append(state.held.pop(state.next))
            state.next, state.begun = state.next + 1, True
        self._held -= len(ready)
        return ready

    def _review(self, source: Source, state: _State[_T], now_s: float) -> None:
        if state.newest < state.next:
            state.tries = 0
            self._lacking.pop(source, None)
        elif source not in self._lacking:
            self._lacking[source] = state
            state.since_s = state.due_s = now_s
