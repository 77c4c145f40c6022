"""Captured data of a calibration session: samples, rests, turns and movements; all times are device time in s."""

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
    """Sensor samples as columns, in sensor axes.

    time (n,): device time, s.
    gyro (n, 3): rad/s as read, uncorrected.
    accel (n, 3): m/s², or None without an accelerometer.
    clipped (n,): True where the bridge, the program that reads the device, marked a reading as clipped: at the limit of
        the full-scale range.
    """

    time: Floats
    gyro: Floats
    accel: Floats | None
    clipped: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.time)

    def between(self, start: float, end: float) -> "Samples":
        """Select the samples with start <= time <= end, device time in s; may be empty."""
        return self.part(
            slice(int(np.searchsorted(self.time, start)), int(np.searchsorted(self.time, end, side="right")))
        )

    def part(self, part: slice) -> "Samples":
        """Select the samples of a slice of row indices."""
        accel = None if self.accel is None else self.accel[part]
        return Samples(self.time[part], self.gyro[part], accel, self.clipped[part])


@dataclass(frozen=True, slots=True, eq=False)
class Rest:
    """Period of stillness with its mean readings in sensor axes; start and end in device time, s.

    n: number of samples.
    bias (3,): mean gyro reading, rad/s.
    std (3,): standard deviation of one gyro reading, rad/s.
    step (3,): rounding step of the gyro readings, rad/s.
    accel (3,): mean accelerometer reading, m/s², or None.
    accel_std (3,): standard deviation of one accelerometer reading, m/s²; None when unknown.
    wander (3,): rad/s, standard deviation of the mean from low-frequency bias wander beyond white noise; 0 in most
        rests.
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
        """Device time in the middle of the rest, s: the time to which `bias` refers."""
        return (self.start + self.end) / 2

    @property
    def rounding_var(self) -> Floats:
        """Variance (3,), (rad/s)², of the mean reading from rounding. This error is the same in every rest."""
        return rounding_var(self.std, self.step)

    @property
    def bias_cov(self) -> Floats:
        """Covariance (3, 3), (rad/s)², of the mean reading as an estimate of the bias: white noise, rounding and wander."""
        return np.diag(mean_var(self.std, self.step, self.n) + self.wander**2)


@dataclass(frozen=True, slots=True, eq=False)
class TurnCapture:
    """Full turn about device axis 0, 1 or 2 (x, y, z), with the rests before and after it.

    samples: the turn, with the last part of the rest before it and the first part of the rest after it.
    """

    axis: int
    samples: Samples
    before: Rest
    after: Rest

    @property
    def checked_by_gravity(self) -> bool:
        """True if gravity before and after the turn can show whether the turn was a full turn.

        The axis of the turn must then be less than 45° from the horizontal plane. False without an accelerometer.
        """
        up = self.before.accel
        return (
            up is not None and self.after.accel is not None and abs(float(up[self.axis])) < _STEEP * np.linalg.norm(up)
        )


@dataclass(frozen=True, slots=True, eq=False)
class Movement:
    """Movement between two rests, with samples that include a short part of both rests.

    full_turn: True if the movement is known to have ended in its start attitude.
    """

    before: Rest
    after: Rest
    samples: Samples
    full_turn: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Capture:
    """Input of a calibration method: the rest before the first turn, and one turn about each axis in the order x, y, z.

    rests: all rests from `rest` to the one after the last turn, in the order of time.
    movements: all movements between rests, full turns or not.
    Methods that use only movements accept fewer than three turns.
    """

    rest: Rest
    turns: tuple[TurnCapture, ...]
    rests: tuple[Rest, ...] = ()
    movements: tuple[Movement, ...] = ()


class History:
    """Buffer of the latest samples of a stream, at least `keep_s` seconds of device time, searchable by device time in s."""

    def __init__(self, keep_s: float = 120.0) -> None:
        self._keep_s = keep_s
        #: rows (n, 9) of windows; Samples are made only on request, which is rare
        self._held: deque[Floats] = deque()

    def take(self, rows: Floats) -> None:
        """Append rows (n, 9), n > 0, and drop blocks of rows older than `keep_s` seconds.

        Columns: device time (s), gyro (3, rad/s), accelerometer (3, m/s²), clipped (0 or 1), temperature (°C).
        """
        held, oldest_needed = self._held, rows.item(-1, TIME) - self._keep_s
        held.append(rows)
        while held[0].item(-1, TIME) < oldest_needed:
            held.popleft()

    def between(self, start: float, end: float) -> Samples:
        """Select the buffered samples with start <= time <= end, device time in s; empty when there are none.

        The result has no accelerometer readings if one of them is missing (NaN).
        """
        held = [rows for rows in self._held if rows.item(-1, TIME) >= start and rows.item(0, TIME) <= end]
        if not held:
            return Samples(np.empty(0), np.empty((0, 3)), None, np.empty(0, bool))
        rows = np.concatenate([_between(rows, start, end) for rows in held])
        accel = None if np.isnan(rows[:, ACCEL.start].sum()) else rows[:, ACCEL].copy()
        return Samples(rows[:, TIME].copy(), rows[:, GYRO].copy(), accel, rows[:, CLIPPED] != 0)

    @property
    def rate_hz(self) -> float:
        """Median sample rate of the buffered samples, Hz; 0 with fewer than two samples."""
        time = np.concatenate([rows[:, TIME] for rows in self._held]) if self._held else np.empty(0)
        return float(1 / np.median(np.diff(time))) if len(time) > 1 else 0.0

    @property
    def largest(self) -> float:
        """Largest absolute gyro reading in the buffer, rad/s, over all axes; 0 for an empty buffer."""
        return max((float(np.abs(rows[:, GYRO]).max()) for rows in self._held), default=0.0)


def _between(rows: Floats, start: float, end: float) -> Floats:
    time = rows[:, TIME]
    return rows[np.searchsorted(time, start) : np.searchsorted(time, end, side="right")]
