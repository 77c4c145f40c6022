"""Subscription on zenoh: receives live messages, and history and missed messages from publishers' caches."""

import logging
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

import zenoh
from zenoh import handlers

from bridge.bus.contract import Message
from bridge.bus.gap_detection import Gap, GapDetector
from bridge.bus.message_queue import MessageQueue, newest_last
from bridge.bus.publisher_cache import IDENTITY_BYTES, STAMP_BYTES, Source
from bridge.bus.zenoh_session import Declared, Joined

if TYPE_CHECKING:
    from bridge.bus.zenoh_bus import ZenohBus

_log = logging.getLogger(__name__)

#: messages taken at once, and batches taken per poll by the session's thread
_BATCH, _TURNS = 512, 8

Found = dict[Source, dict[int, Message]]


class Subscription(MessageQueue, Declared):
    """Queue of the messages that match several key patterns, received over zenoh; see contract.Subscription.

    repaired: True keeps live messages back until the history is delivered (`begin`). The session's GapRepair then
    fetches missed messages (`due`, `answered`).
    prompt: True uses a dedicated thread that takes messages from zenoh at once; False lets the session's thread call
    `poll`.
    capacity: number of live messages that the queue holds.
    """

    def __init__(
        self,
        bus: "ZenohBus",
        subscribers: Sequence[zenoh.Subscriber[handlers.Handler[zenoh.Sample]]],
        patterns: Sequence[str],
        capacity: int,
        *,
        repaired: bool,
        prompt: bool,
    ) -> None:
        MessageQueue.__init__(self, capacity)
        self.patterns, self.repaired, self._prompt = patterns, repaired, prompt
        self._samples = Joined([one.handler for one in subscribers])
        self._sequences: GapDetector[Message] = GapDetector()
        self._order = threading.Lock()  # held while messages enter the queue, to keep their order
        self._begun = threading.Event()
        if not repaired:
            self._begun.set()
        Declared.__init__(self, bus, *subscribers)  # last: from here on the session's thread uses this object
        if prompt:
            bus.run(self._pump, f"receive {patterns[0]}")

    @property
    def caught_up(self) -> bool:
        """True if the history has been delivered, or was not requested."""
        return self._begun.is_set()

    def begin(self, past: Found) -> None:
        """Deliver the history to the queue; live messages follow.

        past: for each publisher, a dict of its messages by message number.
        """
        now_s = time.monotonic()
        self._hand_on(lambda: newest_last(filter(None, (self._sequences.history(*one, now_s) for one in past.items()))))
        self._begun.set()

    def due(self) -> list[Gap]:
        """Return the gaps for which publishers' caches should be queried now.

        The caller must report the answer to each gap by `answered`.
        """
        if not (self.repaired and self.caught_up):
            return []
        with self._order:
            return self._sequences.due(time.monotonic())

    def answered(self, source: Source, found: Found) -> None:
        """Deliver a cache's answer about a gap of the publisher `source`.

        found: for each publisher, a dict of its messages by message number; empty if the publisher was unreachable.
        """
        self._hand_on(lambda: self._sequences.answered(source, found.get(source, {}), time.monotonic()))

    def heard(self, newest: Found) -> None:
        """Compare publishers' newest message numbers with the received ones, to detect a lost last message.

        newest: for each publisher, a dict of its newest message by message number; only the numbers are used.
        """
        with self._order:
            for source, numbers in newest.items():
                self._sequences.heard(source, max(numbers), time.monotonic())

    def poll(self) -> None:
        """Move received messages from zenoh into the queue without waiting; does nothing for a `prompt` subscription."""
        if self._prompt or not self.caught_up:
            return
        try:
            for _ in range(_TURNS):
                if samples := self._arrived():
                    self._take(samples)
        except zenoh.ZError:
            MessageQueue.close(self)

    def close(self) -> None:
        """Unsubscribe and close the queue: readers get no more messages. A second close does nothing."""
        MessageQueue.close(self)
        self._begun.set()
        Declared.close(self)

    def _pump(self) -> None:
        try:
            self._begun.wait()
            while True:
                self._take([self._samples.recv(), *self._arrived()])
        except zenoh.ZError:
            _log.debug("subscription closed")
        finally:
            MessageQueue.close(self)

    def _arrived(self) -> list[zenoh.Sample]:
        found = list[zenoh.Sample]()
        while len(found) < _BATCH and (sample := self._samples.try_recv()) is not None:
            found.append(sample)
        return found

    def _take(self, samples: Sequence[zenoh.Sample]) -> None:
        samples = [sample for sample in samples if sample.kind == zenoh.SampleKind.PUT]
        if not self.repaired:
            self.put([_message(sample) for sample in samples])
            return
        now_s, ready = time.monotonic(), list[Message]()
        with self._order:
            for sample in samples:
                message, stamp = _message(sample), _stamp(sample)
                if stamp is None:  # from a publisher without a cache
                    ready.append(message)
                else:
                    ready += self._sequences.take(Source(message.key, stamp[0]), stamp[1], message, now_s)
            self.put(ready)

    def _hand_on(self, ready: Callable[[], Sequence[Message]]) -> None:
        with self._order:
            self.put(ready(), past=True)
            for key, count in self._sequences.missed.items():
                self.add_missed(count, key)
            self._sequences.missed.clear()


def by_source(samples: Iterable[zenoh.Sample]) -> Found:
    """Return, for each publisher, a dict of its messages by message number; zenoh samples without a number are left out."""
    found: Found = {}
    for sample in samples:
        if (stamp := _stamp(sample)) is not None:
            message = _message(sample)
            found.setdefault(Source(message.key, stamp[0]), {})[stamp[1]] = message
    return found


def _message(sample: zenoh.Sample) -> Message:
    return Message(str(sample.key_expr), sample.payload.to_bytes())


def _stamp(sample: zenoh.Sample) -> tuple[bytes, int] | None:
    """Return the publisher's identity and the message's number; None for a publisher without a cache."""
    if (attachment := sample.attachment) is None or len(stamp := attachment.to_bytes()) != STAMP_BYTES:
        return None
    return stamp[:IDENTITY_BYTES], int.from_bytes(stamp[IDENTITY_BYTES:], "big")
