"""Topic of the bias filter's receipts of one device: a table and a picture for the engineer."""

from collections import deque
from collections.abc import Iterable, Sequence
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
#: the mean NIS of LINES receipts of a right filter exceeds this about once in a thousand times
_LARGE = 2.5


class ReceiptTopic(topics.Topic):
    """Receipts of a device's bias updates since a page first watched, and the few before.

    The latest in words; all as points of the NIS picture.
    """

    of_a_device = worded = True

    def __init__(self, topic: str, desk: Desk) -> None:
        super().__init__(topic, desk)
        self._kept = deque[Receipt](maxlen=POINTS)

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield one text frame with all kept receipts; nothing for an unknown device."""
        if (story := self._story) is None:
            return
        latest_ns = self._kept[-1].time_ns if self._kept else 0
        self._kept += [one for one in story.trail.receipts if one.time_ns > latest_ns]
        nis = story.status.nis if story.status is not None else 0.0
        latest = [*self._kept][-LINES:]
        lines = [_line(one, self._t) for one in reversed(latest)]
        points = [(one.time_ns / 1e9, min(one.nis / len(one.innovation), _MOST), one.accepted) for one in self._kept]
        mean = self._t("device.nis_mean", nis=f"{nis:.2f}") if nis else ""
        verdict, tone = _verdict(latest, nis)
        about = {"verdict": self._t(f"device.filter_{verdict}"), "tone": tone, "mean": mean, "lines": lines}
        yield topics.text(self._topic, {**about, "points": points})


def _verdict(latest: Sequence[Receipt], nis: float) -> tuple[str, str]:
    """Judge the filter by its latest receipts: name of the text that says what to do, and tone.

    nis: mean per degree of freedom, as in Status.
    """
    if not latest:
        return "waits", "busy"
    if 2 * sum(one.accepted for one in latest) <= len(latest):
        return "refuses", "ask"
    return ("doubts", "ask") if nis > _LARGE and len(latest) == LINES else ("well", "well")


def _line(one: Receipt, t: Texts) -> tuple[str, ...]:
    """When, evidence, innovation and its 95 % range in °/s, test ratio, and what became of it."""
    pairs = zip(one.innovation, one.innovation_std, strict=True)
    innovation = "\n".join(number_format.interval(degrees(off), degrees(std), 4) for off, std in pairs)
    verdict = t("device.accepted" if one.accepted else "device.not_accepted")
    why = f"{verdict}: {t.label(one.reason)}" if one.reason else verdict
    return number_format.clock(one.time_ns), t.label(one.kind), innovation, f"{one.test_ratio:.3f}", why
