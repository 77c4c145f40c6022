"""Topic of the bias filter's receipts of one device: a table and a picture for the engineer."""

from collections import deque
from collections.abc import Iterable
from math import degrees

from bridge.wire.messages import Receipt
from estimator.language.texts import Texts
from estimator.web import number_format, topics
from estimator.web.hub import Frame
from estimator.web.site import Desk

#: receipts in the picture, and in the table
POINTS, LINES = 300, 12
#: largest NIS per degree of freedom that is drawn
_MOST = 20.0


class ReceiptTopic(topics.Topic):
    """Receipts of a device's bias updates since a page first watched, and the few before.

    The latest in words; all as points of the NIS picture.
    """

    of_a_device = worded = True

    def __init__(self, topic: str, desk: Desk) -> None:
        super().__init__(topic, desk)
        self._kept = deque[Receipt](maxlen=POINTS)

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield one text frame with all kept receipts; nothing for an unknown device.

        now: monotonic s. now_ns: ns since the Unix epoch.
        """
        if (story := self._story) is None:
            return
        latest_ns = self._kept[-1].time_ns if self._kept else 0
        self._kept += [one for one in story.trail.receipts if one.time_ns > latest_ns]
        nis = story.status.nis if story.status is not None else 0.0
        lines = [_line(one, self._t) for one in reversed([*self._kept][-LINES:])]
        points = [(one.time_ns / 1e9, min(one.nis / len(one.innovation), _MOST), one.accepted) for one in self._kept]
        mean = self._t("device.nis_mean", nis=f"{nis:.2f}") if nis else ""
        yield topics.text(self._topic, {"mean": mean, "lines": lines, "points": points})


def _line(one: Receipt, t: Texts) -> tuple[str, ...]:
    """When, evidence, innovation and its 95 % range in °/s, test ratio, and what became of it."""
    pairs = zip(one.innovation, one.innovation_std, strict=True)
    innovation = "\n".join(number_format.interval(degrees(off), degrees(std), 4) for off, std in pairs)
    verdict = t("device.accepted" if one.accepted else "device.not_accepted")
    why = f"{verdict}: {t.label(one.reason)}" if one.reason else verdict
    return number_format.clock(one.time_ns), t.label(one.kind), innovation, f"{one.test_ratio:.3g}", why
