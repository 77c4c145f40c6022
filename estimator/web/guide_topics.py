"""Topic of a guided calibration: one guide per device, shared by all its viewers."""

from collections.abc import Iterable

from estimator.web import topics
from estimator.web.guide_view import guide_view
from estimator.web.hub import Frame
from estimator.web.site import Desk

#: unchanged instructions are sent again after this long, s, so that a page knows that it is connected
_AGAIN_S = 1.0


class GuideTopic(topics.Topic):
    """Topic with the present instruction of a guided calibration in every language, sent on change and every second."""

    of_a_device = True
    period_s = 0.1

    def __init__(self, topic: str, desk: Desk) -> None:
        super().__init__(topic, desk)
        self._guide, self._raw = desk.guide(self._device), self._client.raw(self._device)
        self._streams = [self._raw]
        self._told: Frame = ""
        self._told_at = 0.0

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield the present content of the guide page (`GuideView`) as a text frame; nothing for an unknown device.

        now: monotonic time, s. now_ns: ns since the Unix epoch.
        """
        if (story := self._story) is None:
            return
        for batch in self._raw.drain():
            if story.hears(batch.bridge):
                self._guide.take_samples(batch)
        if story.status is not None:
            self._guide.take_status(story.status)
        yield topics.text(self._topic, guide_view(self._guide.told(), self._known, self._device, now))

    def frames(self, now: float, now_ns: int) -> Iterable[Frame]:
        """Yield the content as a text frame if it changed, or if a second has passed since the last frame.

        now: monotonic time, s. now_ns: ns since the Unix epoch.
        """
        for frame in self.whole(now, now_ns):
            if frame != self._told or now - self._told_at >= _AGAIN_S:
                self._told, self._told_at = frame, now
                yield frame
