"""Captured data of a calibration session in device time: rests, and turns and movements with the rests around them."""

from collections import deque
from dataclasses import dataclass, field
from math import radians

import numpy as np
from numpy.typing import NDArray

from estimator.geometry.gyro_model import mean_var, rounding_var
from estimator.samples.sample_buffer import ACCEL, CLIPPED, GYRO, TIME

Floats = NDArray[np.float64]
#: sine of the largest angle between a turn's axis and the horizon at which gravity shows the turn
_STEEP = np.sin(radians(45.0))


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Samples as columns: time (n,) s, gyro (n, 3) rad/s as read, accel (n, 3) m/s² or None, clipped (n,) bool."""

    time: Floats
    gyro: Floats
    accel: Floats | None
    clipped: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.time)

    def between(self, start: float, end: float) -> "Samples":
        """Samples with start <= time <= end, device time in s; may be empty."""
        return self.part(
            slice(int(np.searchsorted(self.time, start)), int(np.searchsorted(self.time, end, side="right")))
        )

    def part(self, part: slice) -> "Samples":
        """Return the samples that a slice of row indices selects."""
        accel = None if self.accel is None else self.accel[part]
        return Samples(self.time[part], self.gyro[part], accel, self.clipped[part])


@dataclass(frozen=True, slots=True, eq=False)
class Rest:
    """A period of stillness with its mean readings; start and end in device time, s.

    bias (3,) rad/s: mean gyro reading. std (3,): standard deviation of one of its n readings. step (3,): rounding step.
    accel (3,) m/s²: mean, or None. accel_std (3,): standard deviation of one accelerometer reading, None when unknown.
    wander (3,) rad/s: error of the mean from low-frequency wandering beyond white noise, mostly 0.
    """

    start: float
    end: float
    bias: Floats
    std: Floats
    step: Floats
    n: int
    accel: Floats | None
    accel_std: Floats | None = None
    wander: Floats = field(default_factory=lambda: np.zeros(3))

    @property
    def middle(self) -> float:
        """Device time at which the bias equals the mean reading, s."""
        return (self.start + self.end) / 2

    @property
    def rounding_var(self) -> Floats:
        """Variance (3,), (rad/s)², that rounding leaves in the mean reading: the same error in every rest."""
        return rounding_var(self.std, self.step)

    @property
    def bias_cov(self) -> Floats:
        """Covariance (3, 3), (rad/s)², of the mean reading as the bias: white noise, rounding and wandering."""
        return np.diag(mean_var(self.std, self.step, self.n) + self.wander**2)


@dataclass(frozen=True, slots=True, eq=False)
class TurnCapture:
    """A full turn about device axis 0, 1 or 2: samples from inside the rest before to inside the rest after."""

    axis: int
    samples: Samples
    before: Rest
    after: Rest

    @property
    def checked_by_gravity(self) -> bool:
        """True if gravity before and after shows if the turn was full: its axis must be less than 45° from the horizon.

        False without an accelerometer.
        """
        up = self.before.accel
        return (
            up is not None and self.after.accel is not None and abs(float(up[self.axis])) < _STEEP * np.linalg.norm(up)
        )


@dataclass(frozen=True, slots=True, eq=False)
class Movement:
    """A movement between two rests, with a short part of both; full_turn: it is known to have ended where it began."""

    before: Rest
    after: Rest
    samples: Samples
    full_turn: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Capture:
    """Input of a calibration method: the rest before the first turn, and one turn about each axis in the order x, y, z.

    rests: every rest from that one to the one after the last turn, in the order of time.
    movements: all movements between rests, full turns or not. Turns may be missing for methods that use only movements.
    """

    rest: Rest
    turns: tuple[TurnCapture, ...]
    rests: tuple[Rest, ...] = ()
    movements: tuple[Movement, ...] = ()


class History:
    """Buffer of the latest samples of a stream, at least `keep_s` seconds, searchable by device time."""

    def __init__(self, keep_s: float = 120.0) -> None:
        self._keep_s = keep_s
        #: rows (n, 9) of windows; Samples are made only on request, which is rare
        self._held: deque[Floats] = deque()

    def take(self, rows: Floats) -> None:
        """Append rows (n, 9), n > 0: columns of samples/sample_buffer.py.

        Drop blocks of rows older than `keep_s` seconds.
        """
        held, oldest_needed = self._held, rows.item(-1, TIME) - self._keep_s
        held.append(rows)
        while held[0].item(-1, TIME) < oldest_needed:
            held.popleft()

    def between(self, start: float, end: float) -> Samples:
        """Samples still held with start <= time <= end, device time in s; empty when there are none."""
        held = [rows for rows in self._held if rows.item(-1, TIME) >= start and rows.item(0, TIME) <= end]
        if not held:
            return Samples(np.empty(0), np.empty((0, 3)), None, np.empty(0, bool))
        rows = np.concatenate([_between(rows, start, end) for rows in held])
        accel = None if np.isnan(rows[:, ACCEL.start].sum()) else rows[:, ACCEL].copy()
        return Samples(rows[:, TIME].copy(), rows[:, GYRO].copy(), accel, rows[:, CLIPPED] != 0)

    @property
    def rate_hz(self) -> float:
        """Median sample rate of the samples still held, Hz; 0 when there are none."""
        time = np.concatenate([rows[:, TIME] for rows in self._held]) if self._held else np.empty(0)
        return float(1 / np.median(np.diff(time))) if len(time) > 1 else 0.0

    @property
    def largest(self) -> float:
        """Largest absolute gyro reading still held, rad/s; 0 when there are none."""
        return max((float(np.abs(rows[:, GYRO]).max()) for rows in self._held), default=0.0)


def _between(rows: Floats, start: float, end: float) -> Floats:
    time = rows[:, TIME]
    return rows[np.searchsorted(time, start) : np.searchsorted(time, end, side="right")]
