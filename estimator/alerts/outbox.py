"""Outbox of alerts: gathers what is to be sent to people, and keeps quiet hours. Pure: time is an argument."""

from datetime import datetime
from typing import NamedTuple

from bridge.reasons.codes import Code, Sentence
from bridge.wire.messages import Alert, Placement
from estimator.alerts.board import Change
from estimator.config.alerts import Alerts

#: news wait so long for others, s: a bridge that falls over is one message, not one for each device
GATHER_S = 5.0


def sentence(kind: str, subject: str) -> Sentence:
    """Return an alert as a sentence to be worded later; subject: the device, with its placement, or the estimator."""
    return Code.ALERT(subject=subject, label=f"alert_{kind}")


class News(NamedTuple):
    """An alert, or an all-clear (`cleared`), to be sent to people; subject: device or estimator."""

    subject: str
    placement: Placement | None
    alert: Alert
    cleared: bool


class Outbox:
    """Queue of alerts to be sent; holds alerts during quiet hours, and gathers those that come together.

    An all-clear is sent only for an alert that was sent; a short alert in quiet hours is not.
    """

    def __init__(self, settings: Alerts) -> None:
        #: quiet hours in force
        self.settings = settings
        self._waiting = dict[tuple[str, str], News]()
        self._due_s = float("inf")

    def put(self, subject: str, placement: Placement | None, change: Change, now_s: float) -> None:
        """Queue an alert or an all-clear at monotonic time now_s, s.

        An alert and its all-clear, both unsent, cancel each other.
        """
        key = subject, change.alert.kind
        before = self._waiting.pop(key, None)
        if before is not None and change.cleared != before.cleared:
            return  # neither was sent: whoever was told of the alert, or was not, is right again
        self._waiting[key] = News(subject, placement, change.alert, change.cleared)
        self._due_s = min(self._due_s, now_s + GATHER_S)

    def take(self, now_s: float, local: datetime) -> list[News]:
        """Return the news to be sent now, and forget them; empty while they are gathered, and in quiet hours.

        now_s: monotonic time, s. local: wall clock time.
        """
        if now_s < self._due_s or self.settings.quiet(local):
            return []
        news, self._waiting, self._due_s = list(self._waiting.values()), {}, float("inf")
        return news
