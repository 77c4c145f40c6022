"""What keeps the pages alive: reads the bus a few times a second, and makes the frames of what is watched."""

import asyncio
import logging
import time

from bridge.bus.contract import BusError, Declared
from bridge.wire.messages import BiasRevision, Calibration, DeviceInfo, Note, Status
from estimator.client import Client
from estimator.streams import Stream
from estimator.web import topics
from estimator.web.hub import Hub
from estimator.web.topics import Sources, Topic

log = logging.getLogger(__name__)

#: how often it looks round: the finest distance of two frames
ROUND_S = 0.02
#: how often what is said of devices is read
HEAR_S = 0.2
#: a topic nobody watches any more is kept for so long: a page is often left and come back to
LINGER_S = 5.0
#: a round that is so late has lost its place: frames are left out, not made up for
LATE_S = 1.0


class Heard:
    """What is said of all devices, whether or not anybody looks."""

    def __init__(self, sources: Sources, client: Client, control: Client) -> None:
        known = sources.known
        self._known, self._client = known, client
        self._statuses: Stream[Status] = client.follow()
        self._infos: Stream[DeviceInfo] = client.follow_infos()
        self._calibrations: Stream[Calibration] = client.follow_calibrations()
        self._notes: Stream[Note] = client.follow_notes()
        self._revisions: Stream[BiasRevision] = client.revisions()
        self._watches: list[Declared] = [
            control.watch_alive(what, there.__setitem__) for what, there in known.alive.items()
        ]

    def hear(self, now: float) -> None:
        """Take what has come."""
        self._known.connected = self._client.connected
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

    def close(self) -> None:
        """Stop listening."""
        for thing in (*self._watches, self._statuses, self._infos, self._calibrations, self._notes, self._revisions):
            thing.close()


class Broadcast:
    """The topics that are watched. Everything of it runs in the event loop."""

    def __init__(self, hub: Hub, sources: Sources) -> None:
        self._hub, self._sources = hub, sources
        self._topics: dict[str, Topic] = {}
        self._due: dict[str, float] = {}
        self._last_watched: dict[str, float] = {}
        self._heard: Heard | None = None
        self._hear_at = 0.0

    def connect(self, client: Client, control: Client) -> None:
        """A router is there for the first time; what is watched already begins anew."""
        self._sources.client = client
        self._heard = Heard(self._sources, client, control)
        for topic in list(self._topics):
            self._end(topic)

    async def run(self) -> None:
        """Until cancelled."""
        while True:
            now = time.monotonic()
            try:
                self.step(now, time.time_ns())
            except BusError as error:
                log.warning("%s", error)
            await asyncio.sleep(max(0.001, ROUND_S - (time.monotonic() - now)))

    def step(self, now: float, now_ns: int) -> None:
        """One round."""
        if self._heard is not None and now >= self._hear_at:
            self._hear_at = now + HEAR_S
            self._heard.hear(now)
        for name in self._hub.wanted():
            self._last_watched[name] = now
            if name not in self._topics:
                self._topics[name] = topics.KINDS[name.partition("/")[0]](name, self._sources)
                self._due[name] = now + self._topics[name].period_s
            self._hub.greet(name, self._topics[name].whole(now, now_ns) if name in self._hub.newcomers else ())
        for name, topic in list(self._topics.items()):
            if now - self._last_watched[name] > LINGER_S:
                self._end(name)
            elif now >= self._due[name]:
                late = now - self._due[name] > LATE_S
                self._due[name] = (now if late else self._due[name]) + topic.period_s
                for frame in topic.frames(now, now_ns):
                    self._hub.publish(name, frame)

    def close(self) -> None:
        """Stop listening."""
        for name in list(self._topics):
            self._end(name)
        if self._heard is not None:
            self._heard.close()

    def _end(self, name: str) -> None:
        self._topics.pop(name).close()
        self._due.pop(name)
