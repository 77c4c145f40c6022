"""Messages of many publishers that number them, each in order and exactly once; knows no bus and no clock.

Whoever subscribes asks publishers' caches about what is `due` and hands in what they said. zenoh 1.10.2 has a subscriber that
does this, but it does not understand its own heartbeats and announcements under keys with a chunk like `@v1`, and takes a
publisher that it does not reach yet for one that has nothing left (its issue 2767): one router's restart of ten lost messages.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from heapq import heappop, heappush
from typing import Generic, NamedTuple, TypeVar

_T = TypeVar("_T")

#: when a gap is asked about, after it was noticed and after each try that found nobody; then it is given up. Over a bad line a
#: publisher may be out of reach for as long as a bridge keeps what it has sent
TRIES_S = (0.0, 0.05, 0.2, 0.5, 1.0, 2.0, *(7 * [4.0]))
#: a heartbeat may overtake the last message inside this process
GRACE_S = 0.02
#: however long the tries themselves take
LAST_S = sum(TRIES_S)
#: after so many tries that found nobody, some 4 s at least, that is to be said
IN_VAIN = 6
MOST_HELD = 4096
MOST_SOURCES = 1 << 16
#: publishers that only say of themselves that they have sent something: whoever may speak may make up any number of them
MOST_TOLD = 1 << 12
#: publishers whose beginning is waited for: of a large ward all streams are, before their past has come
MOST_EARLY = 1 << 14
#: after so many messages a publisher's numbers begin anew at zero, 248 days at 5 ms: the one that is nearest is meant
WRAP = 1 << 32


class Gap(NamedTuple):
    """What is to be asked of a publisher: everything from number `start` on; all there is from 0 on."""

    source: str
    key: str
    start: int


@dataclass(slots=True)
class _Source(Generic[_T]):
    key: str
    #: the highest number that came, or that it said it has sent; as all here not begun anew after WRAP
    newest: int
    next: int = 0
    #: whether anything was handed on: what was before is history, of which nobody is promised more than there is
    begun: bool = False
    held: dict[int, _T] = field(default_factory=dict)
    tries: int = 0
    #: since when it has been asked about what is lacking, and nothing came of it
    since_s: float = 0.0
    due_s: float | None = None
    asked: bool = False

    def place(self, number: int) -> int:
        """Where a publisher's number lies beside those that came."""
        near = self.next if self.begun else self.newest
        return near + (number - near + WRAP // 2) % WRAP - WRAP // 2


class Sequences(Generic[_T]):
    """What came of each publisher, and what is missing of it. Methods return what may be handed on now."""

    def __init__(self) -> None:
        self._sources: dict[str, _Source[_T]] = {}
        self._lacking: dict[str, _Source[_T]] = {}
        #: when each of them is to be asked about; with what has been settled meanwhile
        self._agenda: list[tuple[float, str]] = []
        #: those that were only told of, and those of which something came that was not their first
        self._told: dict[str, None] = {}
        self._early: dict[str, None] = {}
        #: how many messages are lost for good, by key
        self.missed: Counter[str] = Counter()
        #: keys of publishers that have been asked in vain, for whoever says so
        self.in_vain: list[str] = []

    def take(self, source: str, key: str, number: int, message: _T, now_s: float) -> Sequence[_T]:
        """A message that came live."""
        state = self._sources.get(source)
        if state is None:
            state = self._new(source, key, number)
            if number:
                self._early[source] = None
        elif (
            len(self._sources) > MOST_SOURCES // 2
        ):  # who says something still has room before who has said something once
            self._sources[source] = self._sources.pop(source)
        number = state.place(number)
        if number == state.next and not state.held:
            state.next, state.newest, state.begun = number + 1, max(state.newest, number), True
            if state.due_s is not None:
                self._review(source, state, now_s)
            return (message,)
        if number < state.next:
            return ()
        state.held[number] = message
        state.newest = max(state.newest, number)
        ready = self._settle(state, state.newest) if len(state.held) > MOST_HELD else self._run(state)
        self._review(source, state, now_s)
        while len(self._early) > MOST_EARLY:
            ready += self._give_up(next(iter(self._early)), now_s)
        return ready

    def heard(self, source: str, key: str, number: int, now_s: float) -> None:
        """A publisher says that its last message had this number."""
        if (state := self._sources.get(source)) is None:
            while len(self._told) >= MOST_TOLD:
                self._forget(next(iter(self._told)))
            state = self._new(source, key, number)
            self._told[source] = None
        state.newest = max(state.newest, state.place(number))
        self._review(source, state, now_s + GRACE_S)

    def history(self, source: str, key: str, found: Mapping[int, _T], now_s: float) -> Sequence[_T]:
        """What a publisher's cache held as the subscription began."""
        state = self._sources.get(source) or self._new(source, key, next(iter(found), 0))
        ready = self._fill(state, found)
        state.due_s = None  # what was said to be last meanwhile may be the next to be read
        self._review(source, state, now_s)
        return ready

    def due(self, now_s: float, most: int = 64) -> list[Gap]:
        """Gaps to ask about now, what waits longest first; each must be `answered`."""
        found: list[Gap] = []
        while len(found) < most and (due_s := self.next_due_s()) is not None and due_s <= now_s:
            source = heappop(self._agenda)[1]
            state = self._lacking[source]
            state.asked = True
            found.append(Gap(source, state.key, state.next % WRAP))
        return found

    def next_due_s(self) -> float | None:
        """When there is something to ask about again."""
        while self._agenda:
            due_s, source = self._agenda[0]
            state = self._lacking.get(source)
            if state is not None and state.due_s == due_s and not state.asked:
                return due_s
            heappop(self._agenda)
        return None

    def answered(self, source: str, found: Mapping[int, _T], now_s: float) -> Sequence[_T]:
        """What a publisher's cache had.

        A cache that was published to is never empty: nothing is the answer of nobody, and to be asked for again.
        """
        state = self._sources.get(source)
        if state is None:
            return ()
        before = state.next
        ready = self._fill(state, found)
        state.asked, state.due_s = False, None
        state.tries = 0 if state.next > before else state.tries + 1
        if state.tries == IN_VAIN:
            self.in_vain.append(state.key)
        if state.tries == len(TRIES_S) or (state.tries and now_s - state.since_s >= LAST_S):
            ready += self._settle(state, state.newest)
            state.newest = state.next - 1  # what was only told of, and may be a lie, is not waited for
        self._review(source, state, now_s)
        return ready

    def _new(self, source: str, key: str, number: int) -> _Source[_T]:
        while len(self._sources) >= MOST_SOURCES:
            oldest = next(iter(self._sources))
            del self._sources[oldest]
            self._lacking.pop(oldest, None)
        state = self._sources[source] = _Source(key, number)
        return state

    def _give_up(self, early: str, now_s: float) -> list[_T]:
        """What came of one whose beginning is waited for, without it."""
        del self._early[early]
        state = self._sources.get(early)
        if state is None or state.begun:
            return []
        ready = self._settle(state, state.newest)
        state.newest, state.tries, state.due_s, state.since_s = state.next - 1, 0, None, now_s
        self._lacking.pop(early, None)
        return ready

    def _forget(self, told: str) -> None:
        """One that was told of, unless something came of it."""
        del self._told[told]
        state = self._sources.get(told)
        if state is not None and not state.begun and not state.held:
            del self._sources[told]
            self._lacking.pop(told, None)

    def _fill(self, state: _Source[_T], found: Mapping[int, _T]) -> list[_T]:
        """Add what a cache had, and hand it on: what is missing in it is nowhere."""
        if not found:
            return []
        placed = {state.place(number): message for number, message in found.items()}
        state.held.update((number, message) for number, message in placed.items() if number >= state.next)
        last = max(placed)
        state.newest = max(state.newest, last)
        return self._settle(state, last)

    def _settle(self, state: _Source[_T], last: int) -> list[_T]:
        """Hand on what is here up to `last`, over gaps that nobody can fill."""
        ready: list[_T] = []
        for number in sorted(number for number in state.held if number <= last):
            if state.begun and number > state.next:
                self.missed[state.key] += number - state.next
            ready.append(state.held.pop(number))
            state.next, state.begun = number + 1, True
        return ready + self._run(state)

    @staticmethod
    def _run(state: _Source[_T]) -> list[_T]:
        ready: list[_T] = []
        while state.next in state.held:
            ready.append(state.held.pop(state.next))
            state.next, state.begun = state.next + 1, True
        return ready

    def _review(self, source: str, state: _Source[_T], from_s: float) -> None:
        if state.newest < state.next:
            state.tries, state.due_s = 0, None
            self._lacking.pop(source, None)
            return
        self._lacking[source] = state
        if state.due_s is None and not state.asked:
            state.since_s = state.since_s if state.tries else from_s
            state.due_s = from_s + TRIES_S[state.tries]
            heappush(self._agenda, (state.due_s, source))
