"""Trail of one device: bias with uncertainty, temperature, rests and events over time. Pure, of bounded size."""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.reasons.codes import Sentences
from bridge.wire.messages import BiasRevision, Floats, Receipt, Status
from estimator.device.lifecycle import NEVER_S
from estimator.tracking.seconds import LENGTH_S

#: most points kept; when full, every other point of the older half is dropped
POINTS = 720
#: rests no further apart than this merge into one, s; evidence no older than this is a rest that goes on
REST_S = 3.0
#: a rest began this long before its first evidence, s
TAUGHT_S = LENGTH_S
RESTS, MARKS, BOOTS, RECEIPTS = 120, 120, 50, 24
#: a clock that goes back by more was reset or is another's; later points are then dropped
BACK_NS = 5 * 10**9
#: marks a device's events that are refused evidence, as the tracker names them: `zaru: the reason`
_REFUSED = ": "


@dataclass(frozen=True, slots=True)
class Mark:
    """Event in a device's history, drawn as a mark in charts.

    time_ns: host time, ns since the Unix epoch. kind: boot, calibrated (calibration accepted), note, or refused
    (calibration rejected, or measurement refused by the bias filter).
    words: text of a note or boot, reason of a calibration, or kind and reason of a refused measurement.
    """

    time_ns: int
    kind: str
    words: str | Sentences


class Trail:
    """History of one device for charts: at most POINTS points, with rests, events and receipts.

    times_ns (n,): host time of each point, ns since the Unix epoch, increasing.
    points (n, 7): bias x, y, z and its standard deviations in rad/s, temperature in °C. A row of NaN separates two
    boots.
    rests: (begin, end), ns since the Unix epoch. marks: events. receipts: latest measurement updates of the bias
    filter.
    """

    def __init__(self) -> None:
        self.times_ns: NDArray[np.int64] = np.zeros(0, np.int64)
        self.points: Floats = np.zeros((0, 7))
        self._behind_ns = 0  # time of the last status, where that status was left out
        self.rests: deque[tuple[int, int]] = deque(maxlen=RESTS)
        self.marks: deque[Mark] = deque(maxlen=MARKS)
        #: latest receipts of the bias filter
        self.receipts: deque[Receipt] = deque(maxlen=RECEIPTS)
        self._events: dict[str, int] | None = None
        self._boot = 0

    def take(self, status: Status) -> None:
        """Add a status (sent once a second and at every change) as a point.

        A status that is not newer than the last point is left out, unless the clock was set back. Two such statuses in
        a row show this, if the second is newer than the first, and over 5 s older than the last point. The second is
        then added, and the points from its time on are removed.
        """
        latest_ns = self.receipts[-1].time_ns if self.receipts else 0
        self.receipts += (one for one in status.receipts if one.time_ns > latest_ns)  # a status may come twice
        behind_ns, self._behind_ns = self._behind_ns, 0
        if self.times_ns.size and status.time_ns <= (latest := self.times_ns[-1]):
            if not 0 < behind_ns < status.time_ns < latest - BACK_NS:
                self._behind_ns = status.time_ns
                return
            self._cut(status.time_ns)
        if self.times_ns.size and self._boot and status.boot != self._boot:
            self._append(status.time_ns - 1, np.full(7, np.nan))  # no line leads from one boot to the next
        self._happenings(status)
        self._append(status.time_ns, (*status.bias, *status.bias_std, status.temperature_c))
        if status.evidence_age_s < NEVER_S:
            self._rest(status.time_ns - round(status.evidence_age_s * 1e9))

    def _append(self, time_ns: int, row: Floats | tuple[float, ...]) -> None:
        if len(self.times_ns) == POINTS:
            self._thin()
        self.times_ns, self.points = np.append(self.times_ns, time_ns), np.vstack([self.points, row])

    def mark(self, mark: Mark) -> None:
        """Add an event to `marks`, unless it is there already."""
        if mark not in self.marks:
            self.marks.append(mark)

    def revise(self, revision: BiasRevision) -> None:
        """Replace past biases and their standard deviations by the estimator's revised values, in rad/s.

        Points between the first and the last time of the revision are replaced. The revised values are interpolated
        linearly.
        """
        times = self.times_ns
        inside = (times >= revision.times_ns[0]) & (times <= revision.times_ns[-1]) & np.isfinite(self.points[:, 0])
        for axis in range(3):
            for column, values in ((axis, revision.bias), (3 + axis, revision.bias_std)):
                known = np.interp(times[inside], revision.times_ns, values[:, axis].astype(float))
                self.points[inside, column] = known

    def spread(self, n: int, begin_ns: int, end_ns: int) -> Floats:
        """Resample the trail to n points at even intervals; returns (n, 7), columns as in `points`.

        begin_ns, end_ns: first and last time, ns since the Unix epoch. Each row is the last point at or before its
        time. It is NaN if that point is missing, or older than the larger of three intervals and 5 s.
        """
        at = np.linspace(begin_ns, end_ns, n).astype(np.int64)
        found = np.full((n, 7), np.nan)
        index = np.searchsorted(self.times_ns, at, side="right") - 1
        too_old_ns = max(3 * (end_ns - begin_ns) / max(1, n - 1), 5e9)
        known = index >= 0
        known[known] = at[known] - self.times_ns[index[known]] < too_old_ns
        found[known] = self.points[index[known]]
        return found

    def _rest(self, at_ns: int) -> None:
        if self.rests and at_ns <= self.rests[-1][1] + REST_S * 1e9:
            begin, end = self.rests[-1]
            self.rests[-1] = begin, max(end, at_ns)
        else:
            self.rests.append((at_ns - round(TAUGHT_S * 1e9), at_ns))

    def _happenings(self, status: Status) -> None:
        if self._boot and status.boot != self._boot:
            self.mark(Mark(status.time_ns, "boot", "started anew"))
        new = self._boot != status.boot
        self._boot = status.boot
        before, self._events = self._events, status.events
        if before is None or new:
            return
        for name, count in status.events.items():
            if _REFUSED in name and count > before.get(name, 0):
                self.mark(Mark(status.time_ns, "refused", name))

    def _cut(self, at_ns: int) -> None:
        n = int(np.searchsorted(self.times_ns, at_ns))
        self.times_ns, self.points = self.times_ns[:n], self.points[:n]
        earlier = [(begin, min(end, at_ns)) for begin, end in self.rests if begin < at_ns]
        self.rests = deque(earlier, self.rests.maxlen)

    def _thin(self) -> None:
        half = POINTS // 2
        gaps = np.flatnonzero(np.isnan(self.points[:half, 0]))[-BOOTS:]
        kept = np.unique(np.concatenate([np.arange(0, half, 2), gaps, np.arange(half, POINTS)]))
        self.times_ns, self.points = self.times_ns[kept], self.points[kept]
