"""Outbox of alerts: groups alerts into messages for people, and keeps quiet hours. Pure: time is an argument."""

from datetime import datetime
from typing import NamedTuple

from bridge.reasons.codes import Code, Sentence
from bridge.wire.messages import Alert, Placement
from estimator.alerts.board import Change
from estimator.config.alerts import Alerts

#: news wait so long for others, s: a bridge that falls over is one message, not one for each device
GATHER_S = 5.0


def sentence(kind: str, subject: str) -> Sentence:
    """Return an alert as a sentence that can be shown in any language.

    kind: kind of alert. subject: id of the device, with its placement, or of the estimator.
    """
    return Code.ALERT(subject=subject, label=f"alert_{kind}")


class News(NamedTuple):
    """Alert to be sent to people or, if `cleared` is True, its all-clear: the news that the fault has ended.

    subject: id of a device or an estimator. placement: that of the device; None if unknown.
    """

    subject: str
    placement: Placement | None
    alert: Alert
    cleared: bool


class Outbox:
    """Queue of alerts to be sent; holds alerts during quiet hours, and groups alerts in one message.

    A message has all alerts that wait when the oldest has waited GATHER_S (5) seconds.
    An all-clear is sent only if its alert was sent. An alert that is raised and cleared within quiet hours is not sent.
    """

    def __init__(self, settings: Alerts) -> None:
        #: quiet hours in force
        self.settings = settings
        self._waiting = dict[tuple[str, str], News]()
        self._due_s = float("inf")

    def put(self, subject: str, placement: Placement | None, change: Change, now_s: float) -> None:
        """Queue an alert or an all-clear. An unsent alert and its all-clear cancel each other.

        subject: id of a device or an estimator. placement: that of the device; None if unknown. change: from `Board`:
        an alert raised or acknowledged, or cleared, which makes an all-clear. now_s: monotonic time, s.
        """
        key = subject, change.alert.kind
        before = self._waiting.pop(key, None)
        if before is not None and change.cleared != before.cleared:
            return  # neither was sent: whoever was told of the alert, or was not, is right again
        self._waiting[key] = News(subject, placement, change.alert, change.cleared)
        self._due_s = min(self._due_s, now_s + GATHER_S)

    def take(self, now_s: float, local: datetime) -> list[News]:
        """Remove and return the alerts to be sent now, as one message.

        Empty in quiet hours, and until the oldest waiting alert has waited GATHER_S (5) seconds.
        now_s: monotonic time, s. local: local wall-clock time.
        """
        if now_s < self._due_s or self.settings.quiet(local):
            return []
        news, self._waiting, self._due_s = list(self._waiting.values()), {}, float("inf")
        return news
