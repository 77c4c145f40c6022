"""What comes of zenoh, in a thread of its own, and what was lost of it, fetched again."""

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import NamedTuple, Self

import zenoh

from bridge.bus.contract import Message
from bridge.bus.inbox import Inbox, Reading, newest_last
from bridge.bus.sequences import Gap, Sequences
from bridge.bus.zenoh_session import Channel, Declared, Home, Undeclared, each, said

_log = logging.getLogger(__name__)

_BATCH = 512
_EVERYBODY = "all of "
#: where an advanced publisher of a key has its cache and its heartbeats; in one, its last number
_ADVANCED, _NUMBER_BYTES = "/@adv/pub/", 4
#: whoever may speak may put something under many keys at once: of no publisher that could be asked for what is missing
_WILD = "*"
_TURN_S = 0.005
#: a message that is said to have been sent may wait for us, unread, for so long at most: then it is asked for again
_UNREAD_S = 1.0
#: how often it is looked whether it was read
_READ_S = 0.02
#: how long caches are asked, and when that is over although zenoh does not say so: what is behind it would wait for ever
PAST_S = 2.0
_OVER_S = 2 * PAST_S


class _Asked(NamedTuple):
    """A question to caches, what has been answered, and when nothing more comes of it."""

    replies: Channel[zenoh.Reply]
    found: list[zenoh.Sample]
    over_s: float

    @classmethod
    def now(cls, replies: Channel[zenoh.Reply]) -> Self:
        return cls(replies, [], time.monotonic() + _OVER_S)

    def over(self) -> bool:
        return _drained(self.replies, self.found) or time.monotonic() >= self.over_s


class Subscription(Reading, Declared):
    """Hands on what comes, from a thread of its own."""

    def __init__(
        self,
        bus: Home,
        subscriber: Undeclared,
        samples: Channel[zenoh.Sample],
        inbox: Inbox,
        patterns: Sequence[str],
    ) -> None:
        super().__init__(bus, subscriber)
        self._samples, self._inbox = samples, inbox
        #: whether nothing waits for us; and when that was so last, and all before was taken
        self._empty, self._emptied_s = False, time.monotonic()
        bus.run(self._pump, f"receive {patterns[0]}")

    def _pump(self) -> None:
        try:
            self._begin()
            while True:
                batch, emptied_s = [self._next()], self._emptied_s
                while len(batch) < _BATCH:
                    if (sample := self._samples.try_recv()) is None:
                        emptied_s = time.monotonic()
                        break
                    batch.append(sample)
                self._take([sample for sample in batch if sample.kind == zenoh.SampleKind.PUT])
                self._emptied_s = emptied_s
        except zenoh.ZError:
            _log.debug("subscription closed")
        finally:
            self._end()

    def _next(self) -> zenoh.Sample:
        sample = self._samples.try_recv()
        if sample is None:
            self._empty = True
            sample = self._samples.recv()
            self._empty = False
        return sample

    def _begin(self) -> None:
        """Before anything is taken."""

    def _end(self) -> None:
        """Nothing will ever come again."""
        self._inbox.close()

    def _take(self, samples: Sequence[zenoh.Sample]) -> None:
        self._inbox.put(map(_message, samples))

    def close(self) -> None:
        """See contract.Subscription."""
        self._end()
        super().close()


class Repaired(Subscription):
    """With what publishers' caches held, and hold of what was lost; see Sequences."""

    def __init__(
        self,
        bus: Home,
        subscriber: Undeclared,
        samples: Channel[zenoh.Sample],
        heartbeats: tuple[Undeclared, Channel[zenoh.Sample]],
        inbox: Inbox,
        patterns: Sequence[str],
        most_past: int | None = None,
    ) -> None:
        self._patterns, self._heartbeats, self._most_past = patterns, heartbeats[0], most_past
        self._sequences: Sequences[Message] = Sequences()
        self._order = threading.Lock()  # of whatever is handed on
        self._past_came = False
        self._early = set[str]()  # publishers that were heard of before their past came
        self._news, self._away = threading.Event(), threading.Event()  # there may be a gap; and perhaps in everything
        self._first = [bus.past(f"{one}/@adv/**", "" if most_past is None else f"_max={most_past}") for one in patterns]
        super().__init__(bus, subscriber, samples, inbox, patterns)
        bus.run(lambda: each(heartbeats[1], self._heard), f"heartbeats of {patterns[0]}")
        bus.run(self._go_on_repairing, f"repair {patterns[0]}")

    def _begin(self) -> None:
        first: list[zenoh.Sample] = []
        over_s = time.monotonic() + _OVER_S
        while (left := [one for one in self._first if not _drained(one, first)]) and time.monotonic() < over_s:
            self._first = left
            time.sleep(_TURN_S)
        self._hand_on(lambda: newest_last([past for one in _by_source(first).items() if (past := self._past_of(*one))]))
        self._past_came = True
        self._news.set()

    def _past_of(self, source: str, found: dict[int, Message]) -> Sequence[Message]:
        return self._sequences.history(source, next(iter(found.values())).key, found, time.monotonic())

    @property
    def caught_up(self) -> bool:
        """See contract.Subscription."""
        return self._past_came

    def _take(self, samples: Sequence[zenoh.Sample]) -> None:
        now_s, ready, cached = time.monotonic(), list[Message](), set[str]()
        with self._order:
            for sample in samples:
                message, info = _message(sample), sample.source_info
                if info is None or _WILD in message.key:  # of a publisher without a cache; or whoever reads refuses it
                    ready.append(message)
                else:
                    cached.add(message.key)
                    ready += self._sequences.take(
                        _source(message.key, info), message.key, info.source_sn, message, now_s
                    )
            self._inbox.put(ready)
            lacking = self._sequences.next_due_s() is not None
        if lacking:
            self._news.set()
        self._bus.learn(cached)

    def _heard(self, sample: zenoh.Sample) -> None:
        """One of zenoh's heartbeats: KEY/@adv/pub/SESSION/PUBLISHER/_, and the number of its last message."""
        key, adv, rest = str(sample.key_expr).rpartition(_ADVANCED)
        said = sample.payload.to_bytes()
        if len(said) != _NUMBER_BYTES or _WILD in key or _WILD in rest:
            _log.debug("no heartbeat: %s", sample.key_expr)
            return
        source = f"{key}{adv}{'/'.join(rest.split('/')[:2])}"
        with self._order:
            if not self._past_came:
                self._early.add(source)
            self._sequences.heard(source, key, int.from_bytes(said, "little"), time.monotonic())
        self._news.set()

    def remind(self) -> None:
        """We were away, and did not hear what we missed: ask everybody for the last message."""
        self._away.set()
        self._news.set()

    def _end(self) -> None:
        super()._end()
        self._news.set()

    def _go_on_repairing(self) -> None:
        try:
            self._repair()
        except zenoh.ZError as error:
            if not self._inbox.closed:
                _log.error("what is lost of %s is not fetched again any more (%s)", self._patterns[0], said(error))

    def _repair(self) -> None:
        """Ask about gaps, all that are due at once; who hangs keeps only its own waiting."""
        asked: dict[str, _Asked] = {}
        while not self._inbox.closed:
            if self._away.is_set() and not any(one.startswith(_EVERYBODY) for one in asked):
                self._away.clear()
                for pattern in self._patterns:
                    asked[_EVERYBODY + pattern] = _Asked.now(self._bus.past(f"{pattern}/@adv/**", "_max=1"))
            with self._order:
                gaps = self._sequences.due(self._read_to_s()) if self._past_came else []
            for gap in gaps:
                try:
                    asked[gap.source] = _Asked.now(self._bus.past(f"{gap.source}/**", self._what(gap)))
                except zenoh.ZError as error:  # somebody gave it a name that cannot be asked for
                    _log.debug("%s cannot be asked: %s", gap.source, said(error))
                    self._answered(gap.source, [])
            for source in [source for source, answer in asked.items() if answer.over()]:
                self._answered(source, asked.pop(source).found)
            with self._order:
                due_s = self._sequences.next_due_s() if self._past_came else None
            wait_s = _TURN_S if asked else None if due_s is None else max(due_s - time.monotonic(), 0.0)
            if wait_s == 0.0:  # it may be among what is not read yet: who reads has better use for the time
                time.sleep(_READ_S)
            self._news.wait(wait_s)
            self._news.clear()

    def _read_to_s(self) -> float:
        """All that came before has been read: what a busy reader hears of before it gets to it is not asked for again."""
        now_s = time.monotonic()
        return now_s if self._empty else max(self._emptied_s, now_s - _UNREAD_S)

    def _what(self, gap: Gap) -> str:
        if gap.start:
            return f"_sn={gap.start}.."
        # Who came later may have been out of reach: nobody else has done any of it.
        return "" if self._most_past is None or gap.source not in self._early else f"_max={self._most_past}"

    def _answered(self, source: str, found: list[zenoh.Sample]) -> None:
        now_s = time.monotonic()
        by_source = _by_source(found)
        if not source.startswith(_EVERYBODY):
            self._hand_on(partial(self._sequences.answered, source, by_source.get(source, {}), now_s))
            return
        with self._order:
            for each, last in by_source.items():
                number, message = max(last.items())
                self._sequences.heard(each, message.key, number, now_s)

    def _hand_on(self, ready: Callable[[], Sequence[Message]]) -> None:
        with self._order:
            self._inbox.put(ready(), past=True)
            for key, count in self._sequences.missed.items():
                self._inbox.add_missed(count, key)
            self._sequences.missed.clear()
            in_vain, self._sequences.in_vain = self._sequences.in_vain, []
        for key in in_vain:
            _log.warning(
                "%s: what is missing of it is asked for in vain; what came since waits for it half a minute", key
            )

    def close(self) -> None:
        """See contract.Subscription."""
        super().close()
        with contextlib.suppress(zenoh.ZError):
            self._heartbeats.undeclare()


def _message(sample: zenoh.Sample) -> Message:
    return Message(str(sample.key_expr), sample.payload.to_bytes())


def _by_source(samples: Iterable[zenoh.Sample]) -> dict[str, dict[int, Message]]:
    """Of each publisher its messages by number."""
    found: dict[str, dict[int, Message]] = {}
    for sample in samples:
        message = _message(sample)
        if (info := sample.source_info) is not None and _WILD not in message.key:
            found.setdefault(_source(message.key, info), {})[info.source_sn] = message
    return found


def _drained(replies: Channel[zenoh.Reply], into: list[zenoh.Sample]) -> bool:
    """Take what has been answered; whether that was all."""
    try:
        while (reply := replies.try_recv()) is not None:
            if reply.ok is not None:
                into.append(reply.ok)
    except zenoh.ZError:
        return True
    return False


def _source(key: str, info: zenoh.SourceInfo) -> str:
    """A publisher, by its key too: who may say something under one key may say there that it is anybody."""
    return f"{key}{_ADVANCED}{info.source_id.zid}/{info.source_id.eid}"
