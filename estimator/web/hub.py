"""One broadcast for all viewers: a frame is made once, and a viewer that is slow loses frames of its own, nobody else's."""

import asyncio
from collections import OrderedDict, deque
from collections.abc import Collection, Iterable

Frame = bytes | str

#: frames of one topic that wait for a viewer; of more the oldest is dropped, and counted
WAITING = 4
#: topics of one viewer
TOPICS = 16
#: viewers at a time, and of those from one address, behind which may be a whole ward
VIEWERS, OF_ONE_ADDRESS = 500, 100


class Viewer:
    """One browser: from where, what it watches and what waits to be sent to it."""

    def __init__(self, address: str = "") -> None:
        self.address = address
        self.topics: set[str] = set()
        self.dropped = 0
        self._waiting: OrderedDict[str, deque[Frame]] = OrderedDict()
        self._ready = asyncio.Event()
        self._closed = False

    def put(self, topic: str, frame: Frame) -> None:
        """A frame for it; never waits."""
        queue = self._waiting.setdefault(topic, deque())
        if len(queue) >= WAITING:
            queue.popleft()
            self.dropped += 1
        queue.append(frame)
        self._ready.set()

    def forget(self, topic: str) -> None:
        """It watches a topic no more."""
        self.topics.discard(topic)
        self._waiting.pop(topic, None)

    async def next(self) -> Frame | None:
        """The next frame, each topic in its turn; None when the viewer was closed."""
        while not self._closed:
            for topic, queue in self._waiting.items():
                if queue:
                    self._waiting.move_to_end(topic)
                    return queue.popleft()
            self._ready.clear()
            await self._ready.wait()
        return None

    def close(self) -> None:
        """Whoever waits for the next frame gets None."""
        self._closed = True
        self._waiting.clear()
        self._ready.set()


class Hub:
    """The viewers there are. Used from the event loop alone."""

    def __init__(self) -> None:
        self.viewers: set[Viewer] = set()
        #: viewers by topic that have just begun to watch it: they get the whole of it first
        self.newcomers: dict[str, set[Viewer]] = {}

    def full(self, address: str) -> str:
        """Why no viewer more is taken from an address; nothing when one is."""
        if len(self.viewers) >= VIEWERS:
            return f"{VIEWERS} pages look already; this one tries again"
        if sum(viewer.address == address for viewer in self.viewers) >= OF_ONE_ADDRESS:
            return f"{OF_ONE_ADDRESS} pages look already from {address}; this one tries again"
        return ""

    def add(self, address: str = "") -> Viewer:
        """A viewer that watches nothing yet."""
        viewer = Viewer(address)
        self.viewers.add(viewer)
        return viewer

    def remove(self, viewer: Viewer) -> None:
        """It is gone."""
        self.watch(viewer, ())
        viewer.close()
        self.viewers.discard(viewer)

    def watch(self, viewer: Viewer, topics: Collection[str]) -> None:
        """From now on it watches exactly these."""
        for topic in viewer.topics - set(topics):
            viewer.forget(topic)
            newcomers = self.newcomers.get(topic, set())
            newcomers.discard(viewer)
            if not newcomers:
                self.newcomers.pop(topic, None)
        for topic in set(topics) - viewer.topics:
            viewer.topics.add(topic)
            self.newcomers.setdefault(topic, set()).add(viewer)

    def wanted(self) -> dict[str, set[str]]:
        """The topics that somebody watches, and from which addresses."""
        found: dict[str, set[str]] = {}
        for viewer in self.viewers:
            for topic in viewer.topics:
                found.setdefault(topic, set()).add(viewer.address)
        return found

    def greet(self, topic: str, frames: Iterable[Frame]) -> None:
        """Give newcomers what they need to begin with."""
        newcomers = self.newcomers.pop(topic, None)
        if newcomers:
            for frame in frames:
                for viewer in newcomers:
                    viewer.put(topic, frame)

    def publish(self, topic: str, frame: Frame) -> None:
        """The same frame to everybody who watches."""
        for viewer in self.viewers:
            if topic in viewer.topics:
                viewer.put(topic, frame)

    def close(self) -> None:
        """Let everybody go."""
        for viewer in list(self.viewers):
            self.remove(viewer)
