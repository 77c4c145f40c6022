"""Topics of the ward page: tiles as text, present rate of each device, and bias over time."""

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
    """Topic with the content of the ward page and all tiles.

    Sent whole every second, so that a lost frame does no harm.
    """

    worded = True

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:
        """Yield the present content of the ward page (`WardPage`) as one text frame.

        now: monotonic time, s. now_ns: ns since the Unix epoch.
        """
        yield topics.text(self._topic, ward_page(self._known, now, now_ns, self._t))


class RatesTopic(topics.Topic):
    """Topic with the magnitude of each device's corrected rate, °/s: minimum and maximum since the last frame."""

    period_s = RATES_S

    def __init__(self, topic: str, desk: Desk) -> None:
        super().__init__(topic, desk)
        self._streams: list[Stream[Rates]] = [desk.client.rates()] if desk.client else []

    def frames(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield one binary frame with the rates since the last frame.

        Layout after the topic's name, little-endian: server time, float64, s since the Unix epoch. Then for each device
        number 0, 1, … two float32: minimum and maximum of the rate's magnitude, °/s. Both are NaN for a device without
        new rates.
        now: monotonic time, s. now_ns: host time, ns since the Unix epoch.
        """
        numbers = {name: story.number for name, story in self._known.stories.items()}
        for stream in self._streams:
            found = extremes(stream.drain(), numbers).astype("<f4")
            yield topics.binary(self._topic, np.float64(now_ns / 1e9).tobytes() + found.tobytes())


def extremes(batches: Sequence[Rates], numbers: Mapping[str, int]) -> Floats:
    """Return minimum and maximum (n, 2) of the rate's magnitude, °/s, by device number; NaN for devices without rates.

    batches: corrected rates, rad/s. numbers: number of each device by id; devices without a number are left out.
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
    """Topic with the bias of each device over time, °/s, at even intervals, for small charts."""

    period_s = 5.0

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield one binary frame with the bias of all devices over at most the last 20 minutes.

        Layout after the topic's name, little-endian: float64 time span, s; then for each device number float32 (SPARKS,
        6). Its columns are bias x, y, z and its standard deviations, °/s, NaN where unknown. Its rows are at even
        intervals over the span, which ends now.
        now: monotonic time, s. now_ns: ns since the Unix epoch.
        """
        trails = [story.trail for story in self._known.stories.values()]
        first_ns = min((int(trail.times_ns[0]) for trail in trails if trail.times_ns.size), default=now_ns)
        begin_ns = max(first_ns, now_ns - round(SPARKS_S * 1e9))
        columns = np.degrees(np.array([trail.spread(SPARKS, begin_ns, now_ns)[:, :6] for trail in trails]))
        yield topics.binary(
            self._topic, np.float64((now_ns - begin_ns) / 1e9).tobytes() + columns.astype("<f4").tobytes()
        )
