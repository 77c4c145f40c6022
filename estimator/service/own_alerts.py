"""Alerts about the estimator itself: disk, clock, certificate and backups of its machine."""

from collections.abc import Callable, Iterable
from pathlib import Path

from bridge.bus.routers import Routers
from bridge.diagnose import machine
from bridge.diagnose.finding import Level
from bridge.wire.messages import Alert
from estimator.alerts.board import Board, Change
from estimator.config.alerts import Alerts
from estimator.database import Database
from estimator.device.attention import Kind

#: interval of looking at the machine, s
LOOK_S = 30.0


class OwnAlerts:
    """Alerts of an estimator about its machine: disk, clock, certificate and backups.

    own: id of the estimator. standing: alerts raised before a restart that have not ended. told(change): called for
    each change of an alert.
    copies_fail(): whether copying backups to the S3 bucket fails. now_s: monotonic time, s. look_up(work): runs work
    that may wait for a disk.
    """

    def __init__(
        self,
        own: str,
        settings: Alerts,
        database: Database,
        routers: Routers,
        told: Callable[[Change], None],
        standing: Iterable[Alert],
        now_s: float,
        look_up: Callable[[Callable[[], None]], None],
        copies_fail: Callable[[], bool] = lambda: False,
    ) -> None:
        self._copies_fail, self._look_up = copies_fail, look_up
        self.id, self._database, self._routers, self._told = own, database, routers, told
        self.board = Board(settings, standing, now_s)
        self._next_s = 0.0
        self._machine = frozenset[Kind]()

    def _look_at_machine(self) -> None:
        """Check free disk space, clock and certificate, for the next `look`; may wait for a disk."""
        found = set[Kind]()
        if self._database.path != ":memory:":
            room = machine.disk({"store": Path(self._database.path).absolute().parent})
            found |= {Kind.DISK} if any(one.level is not Level.OK for one in room) else set()
        status = machine.clock_status()
        if status is not None and machine.clock(status)[0].level is not Level.OK:
            found.add(Kind.CLOCK)
        if self._routers.soon() or self._routers.faults():
            found.add(Kind.CERTIFICATE)
        self._machine = frozenset(found)

    def look(self, now: float, time_ns: int) -> None:
        """Raise and clear the estimator's alerts; called once a second.

        now: monotonic time, s. time_ns: host time, ns since the Unix epoch.
        """
        if now >= self._next_s:
            self._next_s = now + LOOK_S
            self._look_up(self._look_at_machine)
        found = set(self._machine)
        if self._database.trouble:
            found.add(Kind.DISK)
        if self._database.backup_fault or self._copies_fail():
            found.add(Kind.BACKUP)
        for change in self.board.look(found, now, time_ns):
            self._told(change)

    def acknowledge(self, kind: str, who: str, time_ns: int) -> list[Change]:
        """Acknowledge alerts of a kind, or all if `kind` is empty; returns those that nobody had acknowledged before.

        who: the person. time_ns: host time, ns since the Unix epoch.
        """
        seen = self.board.acknowledge(kind, who, time_ns)
        for change in seen:
            self._told(change)
        return seen
