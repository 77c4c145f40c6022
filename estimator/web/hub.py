"""Hub of all viewers: a frame is encoded once for all, and a slow viewer loses only its own frames."""

import asyncio
from collections import OrderedDict, deque
from collections.abc import Collection, Iterable

Frame = bytes | str

#: most frames of a topic that wait for a viewer; beyond that the oldest is dropped and counted
WAITING = 4
#: most topics of one viewer
TOPICS = 16
#: most viewers at a time, and from one address, which may serve a whole ward
VIEWERS, OF_ONE_ADDRESS = 500, 100


class Viewer:
    """Browser page that watches topics: its address, its topics, and the frames waiting to be sent."""

    def __init__(self, address: str = "") -> None:
        self.address = address
        self.topics: set[str] = set()
        self.dropped = 0
        self._waiting: OrderedDict[str, deque[Frame]] = OrderedDict()
        self._ready = asyncio.Event()
        self._closed = False

    def put(self, topic: str, frame: Frame) -> None:
        """Queue a frame of a topic for this viewer, without waiting.

        Beyond WAITING frames of a topic the oldest is dropped.
        """
        queue = self._waiting.setdefault(topic, deque())
        if len(queue) >= WAITING:
            queue.popleft()
            self.dropped += 1
        queue.append(frame)
        self._ready.set()

    def forget(self, topic: str) -> None:
        """Stop watching a topic, and drop its queued frames."""
        self.topics.discard(topic)
        self._waiting.pop(topic, None)

    async def next(self) -> Frame | None:
        """Wait for the next frame, with topics taking turns; None when the viewer has been closed."""
        while not self._closed:
            for topic, queue in self._waiting.items():
                if queue:
                    self._waiting.move_to_end(topic)
                    return queue.popleft()
            self._ready.clear()
            await self._ready.wait()
        return None

    def close(self) -> None:
        """Close the viewer; a pending `next` returns None."""
        self._closed = True
        self._waiting.clear()
        self._ready.set()


class Hub:
    """Set of viewers and the topics that each watches. Used from the event loop only."""

    def __init__(self) -> None:
        self.viewers: set[Viewer] = set()
        #: viewers that just began to watch a topic, by topic; they get its whole content first
        self.newcomers: dict[str, set[Viewer]] = {}

    def full(self, address: str) -> str:
        """Return the reason why no further viewer is accepted from this client address; empty if there is room."""
        if len(self.viewers) >= VIEWERS:
            return f"{VIEWERS} pages are open already; this page tries again"
        if sum(viewer.address == address for viewer in self.viewers) >= OF_ONE_ADDRESS:
            return f"{OF_ONE_ADDRESS} pages are open already from {address}; this page tries again"
        return ""

    def add(self, address: str = "") -> Viewer:
        """Add a viewer without topics, and return it."""
        viewer = Viewer(address)
        self.viewers.add(viewer)
        return viewer

    def remove(self, viewer: Viewer) -> None:
        """Remove a viewer and close it."""
        self.watch(viewer, ())
        viewer.close()
        self.viewers.discard(viewer)

    def watch(self, viewer: Viewer, topics: Collection[str]) -> None:
        """Set the topics that a viewer watches, in place of its earlier ones.

        A viewer that is new to a topic is listed in `newcomers`, until `greet` queues the topic's whole content for it.
        """
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
        """Return the watched topics, each with the set of client addresses that watch it."""
        found: dict[str, set[str]] = {}
        for viewer in self.viewers:
            for topic in viewer.topics:
                found.setdefault(topic, set()).add(viewer.address)
        return found

    def greet(self, topic: str, frames: Iterable[Frame]) -> None:
        """Queue a topic's whole content for the viewers that are new to the topic, and remove them from `newcomers`."""
        newcomers = self.newcomers.pop(topic, None)
        if newcomers:
            for frame in frames:
                for viewer in newcomers:
                    viewer.put(topic, frame)

    def publish(self, topic: str, frame: Frame) -> None:
        """Queue one frame for every viewer of a topic."""
        for viewer in self.viewers:
            if topic in viewer.topics:
                viewer.put(topic, frame)

    def close(self) -> None:
        """Close and remove all viewers."""
        for viewer in list(self.viewers):
            self.remove(viewer)
