"""Alert board of a device or an estimator: raises alerts when faults last, and clears them when faults end. Pure."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

from bridge.wire.messages import Alert
from estimator.config.alerts import Alerts


class Change(NamedTuple):
    """Change of an alert: raised, acknowledged or cleared.

    alert: the alert after the change. cleared: True if the alert is cleared, because its fault has ended.
    """

    alert: Alert
    cleared: bool = False


@dataclass(slots=True)
class _Trouble:
    """Trouble of one kind: when it began and was last seen, monotonic s; its alert once raised."""

    since_s: float
    since_ns: int
    seen_s: float
    alert: Alert | None = None


class Board:
    """Alert board of one device or estimator: its present faults and standing alerts.

    An alert is raised when its fault has lasted for the hold time in `settings`. The alert is cleared when the fault
    has been absent for the time `settings.clear_s`, s; a fault that returns earlier is the same fault.
    standing: alerts raised before a restart, or by the estimator that owned the device before. now_s: monotonic time, s.
    """

    def __init__(self, settings: Alerts, standing: Iterable[Alert] = (), now_s: float = 0.0) -> None:
        #: hold times in force
        self.settings = settings
        self._troubles = {one.kind: _Trouble(now_s, one.since_ns, now_s, one) for one in standing}

    @property
    def standing(self) -> tuple[Alert, ...]:
        """Standing alerts of the device or estimator: raised and not yet cleared, oldest first."""
        found = (trouble.alert for trouble in self._troubles.values() if trouble.alert is not None)
        return tuple(sorted(found, key=lambda one: one.raised_ns))

    def look(self, kinds: Collection[str], now_s: float, now_ns: int) -> list[Change]:
        """Update the board with the kinds of fault that are present now; returns the changes.

        A change is an alert that is now raised or cleared. now_s: monotonic time, s. now_ns: ns since the Unix epoch.
        """
        changes = list[Change]()
        for kind in kinds:
            trouble = self._troubles.setdefault(kind, _Trouble(now_s, now_ns, now_s))
            trouble.seen_s = now_s
            if trouble.alert is None and now_s - trouble.since_s >= self.settings.hold(kind):
                trouble.alert = Alert(kind, trouble.since_ns, now_ns)
                changes.append(Change(trouble.alert))
        for kind, trouble in list(self._troubles.items()):
            if now_s - trouble.seen_s >= self.settings.clear_s and kind not in kinds:
                del self._troubles[kind]
                if trouble.alert is not None:
                    changes.append(Change(trouble.alert, cleared=True))
        return changes

    def acknowledge(self, kind: str, who: str, now_ns: int) -> list[Change]:
        """Mark alerts as acknowledged by a person; returns those newly acknowledged, each as a Change.

        kind: kind of alert; "" for all. who: name of the person. now_ns: ns since the Unix epoch.
        """
        changes = list[Change]()
        for trouble in self._troubles.values():
            if (alert := trouble.alert) is not None and not alert.acknowledged_ns and kind in ("", alert.kind):
                trouble.alert = replace(alert, acknowledged_ns=now_ns, who=who)
                changes.append(Change(trouble.alert))
        return changes
