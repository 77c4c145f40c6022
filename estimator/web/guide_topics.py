"""The topic of a guided calibration: one guide a device, however many look."""

from collections.abc import Iterable

from bridge.wire.messages import SampleBatch
from estimator.client import Stream
from estimator.guide.guide import Guide
from estimator.web import topics
from estimator.web.guide_view import guide_view
from estimator.web.hub import Frame
from estimator.web.topics import Sources

#: what has not changed is told again after so long, so that a page knows it is heard
_AGAIN_S = 1.0


@topics.kind("guide", of_a_device=True)
class GuideTopic:
    """What a person is to do now, in every language; when it changes, and every second."""

    period_s = 0.1

    def __init__(self, topic: str, sources: Sources) -> None:
        self._topic, self._device = topic, topics.device_of(topic)
        self._known, self._guide = sources.known, _guide(sources, self._device)
        self._raw: Stream[SampleBatch] | None = sources.client.raw(self._device) if sources.client else None
        self._told, self._told_at = "", 0.0

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """What is told now."""
        self._look()
        if self._device in self._known.stories:
            yield self._frame(now)

    def frames(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """What is new."""
        self._look()
        if self._device not in self._known.stories:
            return
        frame = self._frame(now)
        if frame != self._told or now - self._told_at >= _AGAIN_S:
            self._told, self._told_at = frame, now
            yield frame

    def close(self) -> None:
        """Stop listening."""
        if self._raw is not None:
            self._raw.close()

    def _look(self) -> None:
        story = self._known.stories.get(self._device)
        for batch in self._raw.drain() if self._raw is not None else ():
            if story is None or story.hears(batch.bridge):
                self._guide.take_samples(batch)
        if story is not None and story.status is not None:
            self._guide.take_status(story.status)

    def _frame(self, now: float) -> str:
        return topics.text(self._topic, guide_view(self._guide.told(), self._known, self._device, now))


def _guide(sources: Sources, device: str) -> Guide:
    knobs = sources.treatment.of(device)
    return Guide(knobs.method, knobs.stillness, horizontal=knobs.horizontal_turns)
