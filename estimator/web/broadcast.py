"""Broadcast loop of the pages: reads the bus many times a second, makes the frames of watched topics."""

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable
from functools import partial

from bridge.bus.contract import BusError, Declared
from bridge.wire.messages import BiasRevision, Calibration, DeviceInfo, Note, Owned, Status
from bridge.wire.refusal import Tally
from estimator.client import Client, Stream
from estimator.web import topics
from estimator.web.hub import Hub
from estimator.web.topics import Sources, Topic

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
    """Subscriptions to messages about all devices (status, info, calibration …), kept even if no page is open."""

    def __init__(self, sources: Sources, client: Client, control: Client) -> None:
        known = sources.known
        self._known, self._client = known, client
        self._statuses: Stream[Status] = client.follow()
        self._infos: Stream[DeviceInfo] = client.follow_infos()
        self._calibrations: Stream[Calibration] = client.follow_calibrations()
        self._notes: Stream[Note] = client.follow_notes()
        self._revisions: Stream[BiasRevision] = client.revisions()
        self._owned: Stream[Owned] = client.follow_owned()
        self._watches: list[Declared] = [
            control.watch_alive(what, partial(known.take_token, what)) for what in known.alive
        ]

    def hear(self, now: float) -> None:
        """Hand the messages received since the last call to the ward's state. now: monotonic time in s."""
        self._known.take_router(now, there=self._client.connected)
        for info in self._infos.drain():
            self._known.take_info(info)
        for status in self._statuses.drain():
            self._known.take_status(status, now)
        for calibration in self._calibrations.drain():
            self._known.take_calibration(calibration)
        for note in self._notes.drain():
            self._known.take_note(note)
        for revision in self._revisions.drain():
            self._known.take_revision(revision)
        for owned in self._owned.drain():
            self._known.take_owned(owned, now)
        self._known.tidy(now)

    def close(self) -> None:
        """Close the subscriptions and the watches on live bridges and estimators."""
        of_devices = self._statuses, self._infos, self._calibrations, self._notes, self._revisions
        for thing in (*self._watches, *of_devices, self._owned):
            thing.close()


class Broadcast:
    """Loop that starts, feeds and ends the topics that pages watch. Runs entirely in the event loop."""

    def __init__(self, hub: Hub, sources: Sources) -> None:
        self._hub, self._sources = hub, sources
        self._topics: dict[str, Topic] = {}
        self._due: dict[str, float] = {}
        self._last_watched: dict[str, float] = {}
        self._watchers: dict[str, set[str]] = {}  # addresses that watch, or watched last
        self._heard: Heard | None = None
        self._hear_at = 0.0
        #: failed topics by kind, and how often a topic found no room
        self.failed, self.left_out = Tally(), Tally()

    def connect(self, client: Client, control: Client) -> None:
        """Start receiving by the sessions of a router, when one is first connected; topics already watched start anew.

        client: session for data; control: session for liveliness and commands.
        """
        self._sources.client = client
        self._heard = Heard(self._sources, client, control)
        for topic in list(self._topics):
            self._end(topic)

    async def run(self) -> None:
        """Run the loop until cancelled: a `step`, then a sleep of at most ROUND_S.

        A failing topic does not stop the others.
        """
        while True:
            self.step(time.monotonic(), time.time_ns())
            now = time.monotonic()
            due = min((self._due[name] for name in self._topics), default=now + ROUND_S)
            await asyncio.sleep(max(LEAST_S, min(due - now, ROUND_S)))

    def step(self, now: float, now_ns: int) -> None:
        """Do the loop's work once: read the bus, start newly watched topics, publish due frames, end unwatched topics.

        now: monotonic time in s; now_ns: time since the Unix epoch in ns.
        """
        if self._heard is not None and now >= self._hear_at:
            self._hear_at = now + HEAR_S
            self._guarded("what is heard", now, partial(self._heard.hear, now))
        for name, who in self._hub.wanted().items():
            if name not in self._topics and now >= self._due.get(name, now) and self._may_begin(name, now, who):
                self._guarded(name, now, partial(self._begin, name, now))
            if name in self._topics and name in self._hub.newcomers:
                self._guarded(name, now, partial(self._greet, name, now, now_ns))
            if name in self._topics:
                self._last_watched[name], self._watchers[name] = now, who
        for name in list(self._topics):
            if now - self._last_watched[name] > LINGER_S:
                self._end(name)
            elif now >= self._due[name]:
                self._guarded(name, now, partial(self._tell, name, now, now_ns))

    def _greet(self, name: str, now: float, now_ns: int) -> None:
        self._hub.greet(name, self._topics[name].whole(now, now_ns))

    def _may_begin(self, name: str, now: float, who: set[str]) -> bool:
        """Whether a topic may start: its device is known, and there is room for one more."""
        device = topics.device_of(name)
        if not device:
            return True
        if device not in self._sources.known.stories:
            return False
        there = [topic for topic in self._topics if topics.device_of(topic)]
        no_others = sum(self._watchers.get(topic, who) <= who for topic in there) if len(who) == 1 else 0
        if len(there) < TOPICS and no_others < TOPICS // 2:
            return True
        self._due[name] = now + AGAIN_S
        if self.left_out.add("topics") == 1:
            log.warning(
                "%d topics of devices are watched: %s waits (more that wait are only counted)", len(there), name
            )
        return False

    def _begin(self, name: str, now: float) -> None:
        self._topics[name] = topics.KINDS[topics.kind_of(name)](name, self._sources)
        self._due[name] = now + self._topics[name].period_s

    def _tell(self, name: str, now: float, now_ns: int) -> None:
        topic, due = self._topics[name], self._due[name]
        self._due[name] = (now if now - due > LATE_S else due) + topic.period_s
        for frame in topic.frames(now, now_ns):
            self._hub.publish(name, frame)

    def _guarded(self, name: str, now: float, work: Callable[[], None]) -> None:
        try:
            work()
        except Exception as error:  # any failure is contained: the topic starts anew
            if self.failed.add(topics.kind_of(name)) == 1:
                log.exception("%s failed and begins anew (more of this kind are only counted)", name)
            else:
                log.debug("%s failed again: %s", name, error)
            if name in self._topics:
                self._end(name)
            self._due[name] = now + AGAIN_S

    def close(self) -> None:
        """Close all topics and all subscriptions."""
        for name in list(self._topics):
            self._end(name)
        if self._heard is not None:
            self._heard.close()

    def _end(self, name: str) -> None:
        self._due.pop(name, None)
        self._last_watched.pop(name, None)
        self._watchers.pop(name, None)
        with contextlib.suppress(BusError):
            self._topics.pop(name).close()
