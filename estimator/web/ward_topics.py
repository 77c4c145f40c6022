"""Topics of the ward page: tiles in words, present rate of each device, and bias over time."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from bridge.wire.codec import Rates
from bridge.wire.messages import Floats
from estimator.client import Stream
from estimator.web import topics
from estimator.web.hub import Frame
from estimator.web.site import Desk
from estimator.web.tiles import ward_page

#: interval of rate frames, s: about 17 a second, no more often than a bridge sends
RATES_S = 0.06
#: points in a tile's bias chart, and its span, s
SPARKS, SPARKS_S = 40, 1200.0


class WardTopic(topics.Topic):
    """Content of the ward page with all tiles, sent whole every second, so that a lost frame costs nothing."""

    worded = True

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:
        """Yield the present content of the ward page as one text frame.

        now: monotonic s. now_ns: ns since the Unix epoch.
        """
        yield topics.text(self._topic, ward_page(self._known, now, now_ns, self._t))


class RatesTopic(topics.Topic):
    """Magnitude of each device's rate: minimum and maximum since the last frame, by device number."""

    period_s = RATES_S

    def __init__(self, topic: str, desk: Desk) -> None:
        super().__init__(topic, desk)
        self._streams: list[Stream[Rates]] = [desk.client.rates()] if desk.client else []

    def frames(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield one binary frame with the rates since the last one.

        float64 server time in s; float32 minimum and maximum of |rate| in °/s by device number, NaN when silent. now,
        now_ns: see Topic.
        """
        numbers = {name: story.number for name, story in self._known.stories.items()}
        for stream in self._streams:
            found = extremes(stream.drain(), numbers).astype("<f4")
            yield topics.binary(self._topic, np.float64(now_ns / 1e9).tobytes() + found.tobytes())


def extremes(batches: Sequence[Rates], numbers: Mapping[str, int]) -> Floats:
    """Return (n, 2) minimum and maximum of the rate's magnitude in °/s by device number; NaN for silent devices.

    numbers: number of each device; devices without a number are left out.
    """
    found = np.full((max(numbers.values(), default=-1) + 1, 2), np.nan)
    known = [batch for batch in batches if batch.device in numbers]
    if not known:
        return found
    rates = np.concatenate([batch.rate for batch in known])
    speed = np.degrees(np.sqrt(np.einsum("ij,ij->i", rates, rates)))
    edges = np.cumsum([0, *(len(batch.rate) for batch in known[:-1])])
    where = np.array([numbers[batch.device] for batch in known])
    np.fmin.at(found[:, 0], where, np.minimum.reduceat(speed, edges))
    np.fmax.at(found[:, 1], where, np.maximum.reduceat(speed, edges))
    return found


class BiasTopic(topics.Topic):
    """Bias of each device over time, at even intervals, for small charts."""

    period_s = 5.0

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield one binary frame with the bias of all devices over the last 20 minutes at most.

        float64 span in s; by device number float32 (SPARKS, 6): bias and std, x, y, z, °/s; NaN where unknown. now,
        now_ns: see Topic.
        """
        trails = [story.trail for story in self._known.stories.values()]
        first_ns = min((int(trail.times_ns[0]) for trail in trails if trail.times_ns.size), default=now_ns)
        begin_ns = max(first_ns, now_ns - round(SPARKS_S * 1e9))
        columns = np.degrees(np.array([trail.spread(SPARKS, begin_ns, now_ns)[:, :6] for trail in trails]))
        yield topics.binary(
            self._topic, np.float64((now_ns - begin_ns) / 1e9).tobytes() + columns.astype("<f4").tobytes()
        )
