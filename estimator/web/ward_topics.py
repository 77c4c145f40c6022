"""The topics of the ward page: its tiles in words, how fast each device turns now, and how its bias went."""

from collections.abc import Iterable

import numpy as np

from bridge.wire.codec import Rates
from estimator.client import Stream
from estimator.web import topics
from estimator.web.hub import Frame
from estimator.web.rate_strips import Strips
from estimator.web.tiles import ward_page
from estimator.web.topics import Sources

#: eighteen redraws a second; no more often than a bridge sends
RATES_S = 0.06
#: points of a tile's bias, and how far back they go
SPARKS, SPARKS_S = 40, 1200.0


@topics.kind("ward", worded=True)
class WardTopic:
    """All tiles, whole every second: a frame that is lost costs nothing."""

    period_s = 1.0

    def __init__(self, topic: str, sources: Sources) -> None:
        self._topic, self._known, self._t = topic, sources.known, topics.texts_of(topic)

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:
        """The page as it is."""
        yield topics.text(self._topic, ward_page(self._known, now, now_ns, self._t))

    frames = whole

    def close(self) -> None:
        """Nothing is held."""


@topics.kind("rates")
class RatesTopic:
    """How fast each device turns: the least and the most since the last frame, by device number."""

    period_s = RATES_S

    def __init__(self, topic: str, sources: Sources) -> None:
        self._topic, self._known = topic, sources.known
        self._strips = Strips()
        self._rates: Stream[Rates] | None = sources.client.rates() if sources.client else None

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - it begins with what comes
        """Nothing: it begins with what comes."""
        return ()

    def frames(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """float64 seconds of the server's clock; float32 least and most of |rate| in °/s by number, NaN when nothing came."""
        if self._rates is None:
            return
        numbers = {name: story.number for name, story in self._known.stories.items()}
        found = self._strips.take(self._rates.drain(), numbers)
        yield topics.binary(self._topic, np.float64(now_ns / 1e9).tobytes() + found.astype("<f4").tobytes())

    def close(self) -> None:
        """Stop listening."""
        if self._rates is not None:
            self._rates.close()


@topics.kind("bias")
class BiasTopic:
    """How the bias of each device went: points at even distances, for small pictures."""

    period_s = 5.0

    def __init__(self, topic: str, sources: Sources) -> None:
        self._topic, self._known = topic, sources.known

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """float64 seconds that are told; by number float32 (SPARKS, 6): bias and std, x, y, z, °/s; NaN is not known."""
        trails = [story.trail for story in self._known.stories.values()]
        first_ns = min((int(trail.times_ns[0]) for trail in trails if len(trail)), default=now_ns)
        begin_ns = max(first_ns, now_ns - round(SPARKS_S * 1e9))
        columns = np.degrees(np.array([trail.spread(SPARKS, begin_ns, now_ns)[:, :6] for trail in trails]))
        yield topics.binary(
            self._topic, np.float64((now_ns - begin_ns) / 1e9).tobytes() + columns.astype("<f4").tobytes()
        )

    frames = whole

    def close(self) -> None:
        """Nothing is held."""
