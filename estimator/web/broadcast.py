"""Broadcast loop: reads the bus many times a second, and makes the frames (messages) of all topics that pages watch."""

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

from bridge.bus.contract import BusError, Declared
from bridge.wire.refusal import Tally
from estimator.client import Client, Stream
from estimator.web.site import Desk
from estimator.web.topic_kinds import kind_of
from estimator.web.topics import Topic, device_of
from estimator.web.ward_state import Known

log = logging.getLogger(__name__)

#: longest and shortest sleep of the loop, s; a new viewer waits no longer than the first
ROUND_S, LEAST_S = 0.05, 0.002
#: interval of reading messages about all devices, s
HEAR_S = 0.2
#: a topic that nobody watches is kept for this long, s, since people often return to a page
LINGER_S = 5.0
#: delay before a failed topic starts anew, s
AGAIN_S = 2.0
#: most topics of devices at a time, since most hold subscriptions, which cost threads; at most half of them may be
#: watched by a single address only
TOPICS = 256
#: a topic whose frames are later than this skips the frames it missed, s
LATE_S = 1.0


class Heard:
    """Subscriptions to messages about all devices (status, info, calibration …), kept even if no page is open.

    known: ward state to which the messages are added. client: bus session for data. control: bus session that tells
    which bridges and estimators are alive.
    """

    def __init__(self, known: Known, client: Client, control: Client) -> None:
        self._known, self._client = known, client
        #: subscriptions, each with the method that takes its messages
        self._streams: list[tuple[Stream[Any], Callable[[Any], None]]] = [
            (client.follow_infos(), known.take_info),
            (client.follow_calibrations(), known.take_calibration),
            (client.follow_notes(), known.take_note),
            (client.revisions(), known.take_revision),
        ]
        #: subscriptions to messages whose time of arrival counts
        self._timed: list[tuple[Stream[Any], Callable[[Any, float], None]]] = [
            (client.follow(), known.take_status),
            (client.follow_owned(), known.take_owned),
        ]
        self._watches: list[Declared] = [
            control.watch_alive(what, partial(known.take_token, what)) for what in known.alive
        ]

    def hear(self, now: float) -> None:
        """Add the messages received since the last call to the ward's state. now: monotonic time, s."""
        self._known.take_router(now, there=self._client.connected)
        for stream, take in self._streams:
            for message in stream.drain():
                take(message)
        for stream, take_at in self._timed:
            for message in stream.drain():
                take_at(message, now)
        self._known.tidy(now)

    def close(self) -> None:
        """Close the subscriptions and the watches on live bridges and estimators."""
        for thing in (*self._watches, *(stream for stream, _ in (*self._streams, *self._timed))):
            thing.close()


@dataclass(slots=True)
class _Running:
    """A topic that pages watch, or watched last: when its next frames are due and when it was last watched, s.

    who: addresses that watch, or watched last.
    """

    topic: Topic
    due: float
    watched: float
    who: set[str]


class Broadcast:
    """Loop that creates, updates and closes the topics watched by pages. Runs entirely in the event loop."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._running: dict[str, _Running] = {}
        #: when a topic that failed, or found no room, may start, monotonic s
        self._again: dict[str, float] = {}
        self._heard: Heard | None = None
        self._hear_at = 0.0
        #: failed topics by kind, and how often a topic found no room
        self.failed, self.left_out = Tally(), Tally()

    def connect(self, client: Client, control: Client) -> None:
        """Subscribe through the first router found, and restart the topics that pages watch already.

        client: bus session for data. control: bus session for commands, and for which bridges and estimators are alive.
        """
        self._desk.client, self._desk.control = client, control
        self._heard = Heard(self._desk.known, client, control)
        for topic in list(self._running):
            self._end(topic)

    async def run(self) -> None:
        """Run the loop until cancelled: a `step`, then a sleep of at most ROUND_S seconds.

        A failing topic does not stop the others.
        """
        while True:
            self.step(time.monotonic(), time.time_ns())
            now = time.monotonic()
            due = min((one.due for one in self._running.values()), default=now + ROUND_S)
            await asyncio.sleep(max(LEAST_S, min(due - now, ROUND_S)))

    def step(self, now: float, now_ns: int) -> None:
        """Run the loop once: read the bus, start newly watched topics, publish due frames, end unwatched topics.

        now: monotonic time, s. now_ns: host time, ns since the Unix epoch.
        """
        if self._heard is not None and now >= self._hear_at:
            self._hear_at = now + HEAR_S
            with self._guarded("what is heard", now):
                self._heard.hear(now)
        for name, who in self._desk.hub.wanted().items():
            with self._guarded(name, now):
                self._watched(name, who, now, now_ns)
        for name, one in list(self._running.items()):
            if now - one.watched > LINGER_S:
                self._end(name)
            elif now >= one.due:
                with self._guarded(name, now):
                    one.due = (now if now - one.due > LATE_S else one.due) + one.topic.period_s
                    for frame in one.topic.frames(now, now_ns):
                        self._desk.hub.publish(name, frame)

    def _watched(self, name: str, who: set[str], now: float, now_ns: int) -> None:
        """Start a topic that addresses `who` watch, unless it runs, and send its new viewers the whole content."""
        if (one := self._running.get(name)) is None:
            kind = kind_of(name)
            if kind is None or now < self._again.get(name, now) or not self._may_begin(name, now, who):
                return
            self._again.pop(name, None)
            one = self._running[name] = _Running(kind(name, self._desk), now + kind.period_s, now, who)
        one.watched, one.who = now, who
        if name in self._desk.hub.newcomers:
            self._desk.hub.greet(name, one.topic.whole(now, now_ns))

    def _may_begin(self, name: str, now: float, who: set[str]) -> bool:
        """Check that a topic's device is known, and that there is room for one more topic."""
        device = device_of(name)
        if not device:
            return True
        if device not in self._desk.known.stories:
            return False
        there = [one for topic, one in self._running.items() if device_of(topic)]
        no_others = sum(one.who <= who for one in there) if len(who) == 1 else 0
        if len(there) < TOPICS and no_others < TOPICS // 2:
            return True
        self._again[name] = now + AGAIN_S
        if self.left_out.add("topics") == 1:
            log.warning(
                "%d topics of devices are watched: %s waits (further waits are counted, not logged)", len(there), name
            )
        return False

    @contextlib.contextmanager
    def _guarded(self, name: str, now: float) -> Iterator[None]:
        """Context that contains any failure of a topic: the topic restarts."""
        try:
            yield
        except Exception as error:
            kind = name.partition("/")[0]
            if self.failed.add(kind) == 1:
                log.exception("%s failed and restarts (further failures are counted, not logged)", name)
            else:
                log.debug("%s failed again: %s", name, error)
            if name in self._running:
                self._end(name)
            self._again[name] = now + AGAIN_S

    def close(self) -> None:
        """Close all topics and all subscriptions."""
        for name in list(self._running):
            self._end(name)
        if self._heard is not None:
            self._heard.close()

    def _end(self, name: str) -> None:
        with contextlib.suppress(BusError):
            self._running.pop(name).topic.close()
