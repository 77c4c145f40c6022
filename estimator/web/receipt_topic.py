"""Topic of the bias filter's receipts of one device: a table and a picture for the engineer."""

from collections import deque
from collections.abc import Iterable
from math import degrees

from bridge.wire.messages import Receipt
from estimator.language.texts import Texts
from estimator.web import number_format, topics
from estimator.web.hub import Frame
from estimator.web.topics import Sources

#: receipts in the picture, and in the table
POINTS, LINES = 300, 12
#: largest NIS per degree of freedom that is drawn
_MOST = 20.0


@topics.kind("receipts", of_a_device=True, worded=True)
class ReceiptTopic(topics.Topic):
    """Receipts of a device's bias updates since a page first watched, and the few before.

    The latest in words; all as points of the NIS picture.
    """

    def __init__(self, topic: str, sources: Sources) -> None:
        super().__init__(topic, sources)
        self._kept = deque[Receipt](maxlen=POINTS)

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield one text frame with all kept receipts."""
        self._look()
        yield self._frame()

    def frames(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - of a topic
        """Yield one text frame with all kept receipts, if there are new ones."""
        if self._look():
            yield self._frame()

    def _look(self) -> bool:
        story = self._known.stories.get(self._device)
        latest = self._kept[-1].time_ns if self._kept else 0
        new = [one for one in story.trail.receipts if one.time_ns > latest] if story is not None else []
        self._kept += new
        return bool(new)

    def _frame(self) -> str:
        story = self._known.stories.get(self._device)
        nis = story.status.nis if story is not None and story.status is not None else 0.0
        lines = [_line(one, self._t) for one in reversed([*self._kept][-LINES:])]
        points = [(one.time_ns / 1e9, min(one.nis / len(one.innovation), _MOST), one.accepted) for one in self._kept]
        mean = self._t("device.nis_mean", nis=f"{nis:.2f}") if nis else ""
        return topics.text(self._topic, {"mean": mean, "lines": lines, "points": points})


def _line(one: Receipt, t: Texts) -> tuple[str, ...]:
    """When, evidence, innovation and its 95 % range in °/s, test ratio, and what became of it."""
    pairs = zip(one.innovation, one.innovation_std, strict=True)
    innovation = "\n".join(number_format.interval(degrees(off), degrees(std), 4) for off, std in pairs)
    verdict = t("device.accepted" if one.accepted else "device.not_accepted")
    why = f"{verdict}: {t.label(one.reason)}" if one.reason else verdict
    return number_format.clock(one.time_ns), t.label(one.kind), innovation, f"{one.test_ratio:.3g}", why
