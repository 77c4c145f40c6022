"""Topics of the ward page: tiles in words, present rate of each device, and bias over time."""

from collections.abc import Iterable

import numpy as np

from bridge.wire.codec import Rates
from estimator.client import Stream
from estimator.web import topics
from estimator.web.hub import Frame
from estimator.web.rate_strips import Strips
from estimator.web.tiles import ward_page
from estimator.web.topics import Sources

#: interval of rate frames, s: about 17 a second, no more often than a bridge sends
RATES_S = 0.06
#: points in a tile's bias chart, and its span, s
SPARKS, SPARKS_S = 40, 1200.0


@topics.kind("ward", worded=True)
class WardTopic(topics.Topic):
    """Content of the ward page with all tiles, sent whole every second, so that a lost frame costs nothing."""

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:
        """Yield the present content of the ward page as one text frame."""
        yield topics.text(self._topic, ward_page(self._known, now, now_ns, self._t))


@topics.kind("rates")
class RatesTopic(topics.Topic):
    """Magnitude of each device's rate: minimum and maximum since the last frame, by device number."""

    period_s = RATES_S

    def __init__(self, topic: str, sources: Sources) -> None:
        super().__init__(topic, sources)
        self._strips = Strips()
        self._rates: Stream[Rates] | None = sources.client.rates() if sources.client else None

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - starts with the next samples
        """Return no frames: the topic starts with the next samples."""
        return ()

    def frames(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield one binary frame with the rates since the last one.

        float64 server time in s; float32 minimum and maximum of |rate| in °/s by device number, NaN when silent.
        """
        if self._rates is None:
            return
        numbers = {name: story.number for name, story in self._known.stories.items()}
        found = self._strips.take(self._rates.drain(), numbers)
        yield topics.binary(self._topic, np.float64(now_ns / 1e9).tobytes() + found.astype("<f4").tobytes())

    def close(self) -> None:
        """Close the subscription to rates."""
        if self._rates is not None:
            self._rates.close()


@topics.kind("bias")
class BiasTopic(topics.Topic):
    """Bias of each device over time, at even intervals, for small charts."""

    period_s = 5.0

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield one binary frame with the bias of all devices over the last 20 minutes at most.

        float64 span in s; by device number float32 (SPARKS, 6): bias and std, x, y, z, °/s; NaN where unknown.
        """
        trails = [story.trail for story in self._known.stories.values()]
        first_ns = min((int(trail.times_ns[0]) for trail in trails if len(trail)), default=now_ns)
        begin_ns = max(first_ns, now_ns - round(SPARKS_S * 1e9))
        columns = np.degrees(np.array([trail.spread(SPARKS, begin_ns, now_ns)[:, :6] for trail in trails]))
        yield topics.binary(
            self._topic, np.float64((now_ns - begin_ns) / 1e9).tobytes() + columns.astype("<f4").tobytes()
        )
