"""Topics of a device's page: text, attitude, raw and corrected rates, bias trail, heading error, receipts."""

from collections import deque
from collections.abc import Iterable, Sequence
from math import asin, degrees, hypot

import numpy as np

from bridge.wire.messages import Floats, Receipt
from estimator.geometry.gyro_model import SIGMAS
from estimator.language.texts import Texts
from estimator.overview.ward import TRACKING
from estimator.web import number_format, topics
from estimator.web.device_page import device_page
from estimator.web.heading_drift import Heading, Lost
from estimator.web.hub import Frame
from estimator.web.site import Desk
from estimator.web.tiles import advice, toned
from estimator.web.traces import Traces
from estimator.web.ward_topics import RATES_S

#: receipts in the picture, and in the table
POINTS, LINES = 300, 12
#: largest NIS per degree of freedom that is drawn
_MOST = 20.0
#: the mean NIS of LINES receipts of a right filter exceeds this less than three times in a thousand (chi-square)
_LARGE = 2.5
#: fewest receipts by which a filter is said to refuse many
_SOME = 4
#: interval of heading frames, s
_HEADING_S = 1.0


class DeviceTopic(topics.Topic):
    """Topic with the content of the device page, sent whole once a second.

    No frames for a device that was forgotten.
    """

    of_a_device = worded = True

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:
        """Yield the present content of the page (`DevicePage`) as one text frame; nothing for an unknown device.

        now: monotonic time, s. now_ns: ns since the Unix epoch.
        """
        if self._story is not None:
            told = self._desk.treatment.told(self._device)
            yield topics.text(self._topic, device_page(self._known, self._device, now, now_ns, self._t, told))


class TraceTopic(topics.Topic):
    """Topic with the raw and corrected rates of a device, as binary frames in °/s.

    Once a second also the heading error of the raw rates, as text.
    """

    of_a_device = True
    period_s = RATES_S

    def __init__(self, topic: str, desk: Desk) -> None:
        super().__init__(topic, desk)
        self._traces, self._heading = Traces(), Heading()
        self._raw = self._client.raw(self._device)
        self._corrected = self._client.corrected(self._device, quiet=True)
        self._streams = [self._raw, self._corrected]
        self._told_at = 0.0

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield the rates of the last 20 s as a binary frame, then the heading error (degrees) as text.

        Binary frame: float64 (n,) host time, s since the Unix epoch; then float32 (n, 3) raw rates, corrected rates and
        their standard deviation, °/s.
        Text: `since` (start of the integration, as text), `vertical` and `turned` (degrees) as in `Heading`, `now`
        (latest error) and `points` (one a second). An error is a list: host time (s), read, zeroed, std, as in `Lost`.
        now: monotonic time, s. now_ns: ns since the Unix epoch.
        """
        if (kept := self._traces.kept()) is not None:
            yield self._frame(kept)
        yield self._headings()

    def frames(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield the new points as a binary frame, as in `whole`.

        Once a second, a text frame with the heading error (degrees) follows, as in `whole`.
        now: monotonic time, s. now_ns: ns since the Unix epoch.
        """
        story = self._story
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

    def _frame(self, points: Floats) -> bytes:
        """Binary frame: float64 (n,) host time in s, then float32 (n, 3) raw, corrected and std, °/s.

        n follows from the length of the frame.
        """
        rates = np.degrees(np.concatenate([points[:, 1:4], points[:, 4:7], points[:, 7:]])).astype("<f4")
        return topics.binary(self._topic, points[:, 0].astype("<f8").tobytes() + rates.tobytes())

    def _headings(self) -> str:
        """Text frame: start time, and for each second time, read, zeroed and std of the lost heading, in degrees."""
        heading = self._heading
        since = number_format.clock(round(heading.since_s * 1e9)) if heading.since_s else ""
        about = {"since": since, "vertical": heading.vertical, "turned": degrees(heading.turned)}
        points = [_in_degrees(point) for point in heading.points]
        return topics.text(self._topic, {**about, "now": _in_degrees(heading.now), "points": points})


def _in_degrees(lost: Lost) -> tuple[float, ...]:
    return round(lost.time_s, 2), *(round(degrees(angle), 3) for angle in (lost.read, lost.zeroed, lost.std))


class AttitudeTopic(topics.Topic):
    """Topic with the attitude of a device, ten times a second, as text.

    Unit quaternion from sensor to earth axes, scalar first; tilt and heading with their 95 % intervals, degrees.
    The estimator computes attitudes only while somebody subscribes to them.
    """

    of_a_device = True
    period_s = 0.1

    def __init__(self, topic: str, desk: Desk) -> None:
        super().__init__(topic, desk)
        self._attitudes = self._client.orientation(self._device)
        self._streams = [self._attitudes]

    def frames(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield the newest attitude as one text frame, if a new one has arrived since the last call.

        Keys: quat_wxyz (4); tilt, heading, and half the widths of their 95 % intervals tilt_band, heading_band, degrees.
        now: monotonic time, s. now_ns: ns since the Unix epoch.
        """
        if (batch := self._attitudes.latest()) is not None:
            w, x, y, z = map(float, batch.quat_wxyz[-1])
            about = {
                "quat_wxyz": (w, x, y, z),
                "tilt": degrees(2 * asin(min(hypot(x, y), 1.0))),
                "tilt_band": degrees(SIGMAS * batch.tilt_std),
                "heading": degrees(batch.heading[-1]),
                "heading_band": degrees(SIGMAS * batch.heading_std),
            }
            yield topics.text(self._topic, about)


class TrailTopic(topics.Topic):
    """Topic with bias and temperature of a device over time, and its rests and events; sent whole every 5 s."""

    of_a_device = True
    period_s = 5.0

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield rests and events (times in s since the Unix epoch) as text, then the points as a binary frame.

        Text: `rests`, pairs (start, end); `marks`, pairs (time, kind) with the kinds of `device_trail.Mark`.
        Binary frame: float64 (n,) host time, s since the Unix epoch; then float32 (n, 7): bias x, y, z and its standard
        deviations in °/s, temperature in °C.
        now: monotonic time, s. now_ns: ns since the Unix epoch.
        """
        if self._story is None or not (trail := self._story.trail).times_ns.size:
            return
        rests = [(begin / 1e9, end / 1e9) for begin, end in trail.rests]
        marks = [(mark.time_ns / 1e9, mark.kind) for mark in trail.marks]
        yield topics.text(self._topic, {"rests": rests, "marks": marks})
        columns = trail.points.copy()
        columns[:, :6] = np.degrees(columns[:, :6])
        yield topics.binary(self._topic, (trail.times_ns / 1e9).tobytes() + columns.astype("<f4").tobytes())


class ReceiptTopic(topics.Topic):
    """Topic with the receipts of a device's bias updates: those since a page first watched, and a few earlier ones.

    The latest are sent as sentences, and all as points of the NIS chart.
    """

    of_a_device = worded = True

    def __init__(self, topic: str, desk: Desk) -> None:
        super().__init__(topic, desk)
        self._kept = deque[Receipt](maxlen=POINTS)
        self._boot = 0

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield one text frame with all kept receipts; nothing for an unknown device.

        Keys: `verdict` on the filter and its colour class `tone`, `mean` NIS as text, `lines` (latest receipts as texts),
        and `points` (host time in s since the Unix epoch, NIS per degree of freedom, whether accepted).
        For a device that does not track, `verdict` says what to do with the device.
        now: monotonic time, s. now_ns: ns since the Unix epoch.
        """
        if (story := self._story) is None:
            return
        if story.status is not None and story.status.boot != self._boot:
            self._kept.clear()
            self._boot = story.status.boot
        latest_ns = self._kept[-1].time_ns if self._kept else 0
        self._kept += [one for one in story.trail.receipts if one.time_ns > latest_ns]
        nis = story.status.nis if story.status is not None else 0.0
        latest = [*self._kept][-LINES:]
        lines = [_line(one, self._t) for one in reversed(latest)]
        points = [(one.time_ns / 1e9, min(one.nis / len(one.innovation), _MOST), one.accepted) for one in self._kept]
        mean = self._t("device.nis_mean", nis=f"{nis:.2f}") if nis else ""
        row = self._known.row(self._device, now)
        verdict, tone = _verdict(latest)
        said = self._t(f"device.filter_{verdict}")
        if row.state != TRACKING:
            said, tone = advice(row, story, self._t), toned(row)
        about = {"verdict": said, "tone": tone, "mean": mean, "lines": lines}
        yield topics.text(self._topic, {**about, "points": points})


def _verdict(latest: Sequence[Receipt]) -> tuple[str, str]:
    """Judge the filter by its latest receipts: name of the text that says what to do, and tone."""
    if not latest:
        return "waits", "busy"
    if len(latest) >= _SOME and 2 * sum(one.accepted for one in latest) <= len(latest):
        return "refuses", "ask"
    large = len(latest) == LINES and sum(one.nis / len(one.innovation) for one in latest) > LINES * _LARGE
    return ("doubts", "ask") if large else ("well", "well")


def _line(one: Receipt, t: Texts) -> tuple[str, ...]:
    """When, evidence, innovation and its 95 % range in °/s, test ratio, and what became of it."""
    pairs = zip(one.innovation, one.innovation_std, strict=True)
    innovation = "\n".join(number_format.interval(degrees(off), degrees(std), 4) for off, std in pairs)
    verdict = t("device.accepted" if one.accepted else "device.not_accepted")
    why = f"{verdict}: {t.label(one.reason)}" if one.reason else verdict
    return number_format.clock(one.time_ns), t.label(one.kind), innovation, f"{one.test_ratio:.3f}", why
