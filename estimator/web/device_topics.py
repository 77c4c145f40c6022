"""Topics of a device's page: text, attitude, raw and corrected rates, bias trail, and heading error of raw rates."""

from collections.abc import Iterable
from math import asin, degrees, hypot

import numpy as np

from bridge.wire.messages import SampleBatch
from estimator.client import Corrected, Stream
from estimator.geometry.gyro_model import SIGMAS
from estimator.web import number_format, topics
from estimator.web.device_page import device_page
from estimator.web.device_trail import Trail
from estimator.web.heading_drift import Heading, Lost
from estimator.web.hub import Frame
from estimator.web.topics import Sources
from estimator.web.traces import Points, Traces
from estimator.web.ward_topics import RATES_S

#: interval of heading frames, s
_HEADING_S = 1.0


@topics.kind("device", of_a_device=True, worded=True)
class DeviceTopic(topics.Topic):
    """Content of the device page, whole, once a second; no frames for a device never heard of."""

    def __init__(self, topic: str, sources: Sources) -> None:
        super().__init__(topic, sources)
        self._sources = sources

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:
        """Yield the present content of the page as one text frame; nothing for an unknown device."""
        if self._device in self._known.stories:
            told = self._sources.treatment.told(self._device)
            yield topics.text(self._topic, device_page(self._known, self._device, now, now_ns, self._t, told))


@topics.kind("trace", of_a_device=True)
class TraceTopic(topics.Topic):
    """Raw and corrected rates of a device point by point, as binary frames in °/s.

    Once a second also the heading error of the raw rates, as text.
    """

    period_s = RATES_S

    def __init__(self, topic: str, sources: Sources) -> None:
        super().__init__(topic, sources)
        self._traces, self._heading = Traces(), Heading()
        self._raw: Stream[SampleBatch] | None = None
        self._corrected: Corrected | None = None
        self._told_at = 0.0
        if sources.client is not None:
            self._raw, self._corrected = (
                sources.client.raw(self._device),
                sources.client.corrected(self._device, quiet=True),
            )

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield the raw and corrected rates of the last 20 s as a binary frame, then the heading error as text."""
        if (kept := self._traces.kept()) is not None:
            yield self._frame(kept)
        yield self._headings()

    def frames(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield the new points as a binary frame, and once a second the heading error as text."""
        if self._raw is None or self._corrected is None:
            return
        story = self._known.stories.get(self._device)
        if story is not None and story.trail.rests:
            self._heading.restart(story.trail.rests[-1][0] / 1e9)
        raw = [batch for batch in self._raw.drain() if story is None or story.hears(batch.bridge)]
        pairs = self._traces.take(now, raw, self._corrected.drain())
        for pair in pairs:
            self._heading.add(pair)
        if (points := self._traces.points(pairs)) is not None:
            yield self._frame(points)
        if now - self._told_at >= _HEADING_S:
            self._told_at = now
            yield self._headings()

    def close(self) -> None:
        """Close the subscriptions to raw and corrected rates."""
        for stream in (self._raw, self._corrected):
            if stream is not None:
                stream.close()

    def _frame(self, points: Points) -> bytes:
        """Binary frame: float64 (n,) host time in s, then float32 (n, 3) raw, corrected and std, °/s.

        n follows from the length of the frame.
        """
        rates = np.degrees(np.concatenate([points.raw, points.corrected, points.std])).astype("<f4")
        return topics.binary(self._topic, points.time_s.astype("<f8").tobytes() + rates.tobytes())

    def _headings(self) -> str:
        """Text frame: start time, and for each second time, read, zeroed and std of the lost heading, in degrees."""
        heading = self._heading
        since = number_format.clock(round(heading.since_s * 1e9)) if heading.since_s else ""
        about = {"since": since, "vertical": heading.vertical, "turned": degrees(heading.turned)}
        points = [_in_degrees(point) for point in heading.points]
        return topics.text(self._topic, {**about, "now": _in_degrees(heading.now), "points": points})


def _in_degrees(lost: Lost) -> tuple[float, ...]:
    return round(lost.time_s, 2), *(round(degrees(angle), 3) for angle in (lost.read, lost.zeroed, lost.std))


@topics.kind("attitude", of_a_device=True)
class AttitudeTopic(topics.Topic):
    """Attitude of a device ten times a second, as text.

    Unit quaternion from sensor to earth axes, scalar first; tilt and heading with their 95 % bands, degrees.
    """

    period_s = 0.1

    def __init__(self, topic: str, sources: Sources) -> None:
        super().__init__(topic, sources)
        self._stream = sources.client.orientation(self._device) if sources.client is not None else None

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Return no frames for a new viewer: the next attitude comes within 0.1 s."""
        return ()

    def frames(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield the newest attitude as one text frame, if a new one has come since the last call."""
        batch = self._stream.latest() if self._stream is not None else None
        if batch is not None:
            w, x, y, z = map(float, batch.quat_wxyz[-1])
            about = {
                "quat_wxyz": (w, x, y, z),
                "tilt": degrees(2 * asin(min(hypot(x, y), 1.0))),
                "tilt_band": degrees(SIGMAS * batch.tilt_std),
                "heading": degrees(batch.heading[-1]),
                "heading_band": degrees(SIGMAS * batch.heading_std),
            }
            yield topics.text(self._topic, about)

    def close(self) -> None:
        """Close the subscription: the estimator then makes no attitudes for this page."""
        if self._stream is not None:
            self._stream.close()


@topics.kind("trail", of_a_device=True)
class TrailTopic(topics.Topic):
    """Bias and temperature of a device over time, with rests and marks; sent whole every 5 s."""

    period_s = 5.0

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield rests and marks (times in s since the Unix epoch) as text, then the points as a binary frame.

        The frame: float64 (n,) times in s, then float32 (n, 7) bias x, y, z and its std in °/s, temperature in °C.
        """
        story = self._known.stories.get(self._device)
        if story is None or not len(story.trail):
            return
        trail: Trail = story.trail
        yield topics.text(
            self._topic,
            {
                "rests": [(begin / 1e9, end / 1e9) for begin, end in trail.rests],
                "marks": [(mark.time_ns / 1e9, mark.kind) for mark in trail.marks],
            },
        )
        columns = trail.points.copy()
        columns[:, :6] = np.degrees(columns[:, :6])
        yield topics.binary(self._topic, (trail.times_ns / 1e9).tobytes() + columns.astype("<f4").tobytes())
