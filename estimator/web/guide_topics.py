"""Topic of a guided calibration: one guide per device, however many people watch."""

from collections.abc import Iterable

from bridge.wire.messages import SampleBatch
from estimator.client import Stream
from estimator.guide.guide import Guide
from estimator.web import topics
from estimator.web.guide_view import guide_view
from estimator.web.hub import Frame
from estimator.web.topics import Sources

#: unchanged instructions are sent again after this long, s, so that a page knows that it is connected
_AGAIN_S = 1.0


@topics.kind("guide", of_a_device=True)
class GuideTopic(topics.Topic):
    """Present instruction of a guided calibration in every language, sent when it changes and every second."""

    period_s = 0.1

    def __init__(self, topic: str, sources: Sources) -> None:
        super().__init__(topic, sources)
        self._guide = _guide(sources, self._device)
        self._raw: Stream[SampleBatch] | None = sources.client.raw(self._device) if sources.client else None
        self._told, self._told_at = "", 0.0

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield the present instruction as a text frame; nothing for an unknown device."""
        self._look()
        if self._device in self._known.stories:
            yield self._frame(now)

    def frames(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield the instruction as a text frame, if it changed or was last sent a second ago."""
        self._look()
        if self._device not in self._known.stories:
            return
        frame = self._frame(now)
        if frame != self._told or now - self._told_at >= _AGAIN_S:
            self._told, self._told_at = frame, now
            yield frame

    def close(self) -> None:
        """Close the subscription to raw readings."""
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
    story = sources.known.stories.get(device)
    knobs = sources.treatment.of(device, story.info.model if story and story.info else "")
    return Guide(knobs.method, knobs.prior.noise_std, horizontal=knobs.horizontal_turns)
