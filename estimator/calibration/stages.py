"""Rests of a calibration session, and the movements between them, found from windows judged still or moving."""

from dataclasses import dataclass
from math import radians

import numpy as np

from estimator.calibration.capture import Floats, History, Movement, Rest, Samples
from estimator.geometry.gyro_model import least_step

#: range of a working accelerometer's magnitude at rest, m/s²
LEAST_GRAVITY, MOST_GRAVITY = 7.0, 13.0
#: fewest samples for a usable standard deviation
_FEWEST = 8
#: largest ratio of the variance of piece means to its expectation for white noise
_WHITE = 6.0
#: largest distance of a piece's mean from the rest's mean, in standard deviations of its noise
_CREEP = 5.0
#: s; a shorter pause belongs to the movement: a turn pushed in several goes
REST_S = 2.0
#: s, most of a long rest that is used for the bias: its latest part
LONGEST_S = 30.0
#: s, part of the rest added to a movement at each end: losing 0.1 s of a turn costs 1.6 % of k, a second of rest 0.015 %
_MARGIN_S = 0.4
#: s, end of a rest that cannot be told from the beginning of the movement
_EDGE_S = 0.13
#: s, longest slow movement (creep) at either end of a rest that belongs to the turn beside it
_CREEP_S = 1.5
#: least difference of a creep from the rest, rad/s, beyond the noise of a piece of the rest
_LEAST_CREEP = radians(0.03)
#: s, length of the pieces of a rest that are compared
_PIECE_S = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """Event: stillness has become long enough for a rest (`after`).

    before: the rest before it; None when there was none.
    pause_s: longest stillness between the two rests that was too short for a rest, s.
    """

    before: Rest | None
    after: Rest
    pause_s: float


class Stages:
    """Finder of the rests of a session and the movements between them: takes windows, returns one Settled event per rest.

    history: buffer of the latest samples. It must hold the current rest, of which the last 30 s are used, and the
        movement before the rest.
    still_s: seconds for which the device has been still; 0 while it moves.
    not_gravity: accelerometer magnitude in the latest rest, m/s², if outside 7 to 13 m/s²; else 0.
    """

    def __init__(self, history: History) -> None:
        self.still_s = 0.0
        self._history = history
        self._still_since: float | None = None
        self._still_until = 0.0
        self._settled = False
        self._pause_s = 0.0
        self._before: Rest | None = None
        #: accelerometer magnitude in the latest rest, m/s², if implausible as gravity; else 0
        self.not_gravity = 0.0

    def take(self, begun: float, ended: float, *, still: bool) -> Settled | None:
        """Process one window of the stillness detector; return Settled when stillness becomes a rest, at 2 s, else None.

        Windows must come in the order of time.
        begun, ended: start and end of the window, device time in s.
        still: True if the stillness detector judged the window still.
        """
        if not still:
            if self._still_since is not None:
                # After a gap in the stream the rest ended with its last window.
                self._end_rest(self._still_since, min(begun - _EDGE_S, self._still_until))
            return None
        if self._still_since is None:
            # The first still window after a movement may contain the movement's end.
            moved_s = _EDGE_S if self._before else 0.0
            self._still_since = min(ended, begun + moved_s)
        self._still_until = ended
        self.still_s = ended - self._still_since
        if self._settled or self.still_s < REST_S:
            return None
        rest = self._measure(self._still_since, ended, goes_on=True)
        self._settled = rest is not None
        return None if rest is None else Settled(self._before, rest, self._pause_s)

    def _end_rest(self, since: float, end: float) -> None:
        self._pause_s = max(self._pause_s, self.still_s)
        if self._settled:
            self._before, self._pause_s = self._measure(since, end), 0.0
        self._still_since, self._settled, self.still_s = None, False, 0.0

    def _measure(self, start: float, end: float, *, goes_on: bool = False) -> Rest | None:
        """Mean readings of a rest from the samples still held; None when a gap has pushed these out of the history."""
        still = self._history.between(max(start, end - LONGEST_S), end)
        if len(still) < _FEWEST:
            return None
        still = without_creep(still, goes_on=goes_on)
        accel = None if still.accel is None else still.accel.mean(axis=0)
        size = 0.0 if accel is None else float(np.linalg.norm(accel))
        self.not_gravity = 0.0 if accel is None or LEAST_GRAVITY < size < MOST_GRAVITY else max(size, 0.01)
        if self.not_gravity:
            accel = None  # dead, saturated or in other units: does not show the vertical
        accel_std = None if still.accel is None or accel is None else still.accel.std(axis=0, ddof=1)
        std = still.gyro.std(axis=0, ddof=1)
        start, end = float(still.time[0]), float(still.time[-1])
        mean, step = still.gyro.mean(axis=0), least_step(still.gyro)
        return Rest(start, end, mean, std, step, len(still), accel, accel_std, wander=wander(still.gyro, step))

    def movement(self, before: Rest, after: Rest) -> Movement:
        """Build the movement between two rests, with its samples and up to 0.4 s of either rest.

        At most half of a rest is included.
        """
        lead = min(_MARGIN_S, (before.end - before.start) / 2)
        tail = min(_MARGIN_S, (after.end - after.start) / 2)
        return Movement(before, after, self._history.between(before.end - lead, after.start + tail))


def without_creep(still: Samples, *, goes_on: bool = False) -> Samples:
    """Remove slow movement at either end of a rest, as when a hand lets go of the device or takes hold of it.

    goes_on: True for a rest that still continues.
    Pieces of 0.25 s are compared with the calm part of the rest. That is the middle half, or the latest half for a rest
    that still continues. At most 1.5 s is removed at each end.
    """
    size = max(2, int(np.searchsorted(still.time - still.time[0], _PIECE_S)))
    count = len(still) // size
    if count < 4:
        return still
    pieces = still.gyro[: count * size].reshape(count, size, 3)
    means = pieces.mean(axis=1)
    calm = slice(count // 2, None) if goes_on else slice(count // 4, count - count // 4)
    noise = np.maximum(np.median(pieces.std(axis=1, ddof=1), axis=0), least_step(still.gyro) / 2) / np.sqrt(size)
    near = (np.abs(means - np.median(means[calm], axis=0)) < _LEAST_CREEP + _CREEP * noise).all(axis=1)
    most = min(int(_CREEP_S / _PIECE_S), (count - 2) // 2)
    creeping = np.flatnonzero(~near)
    begin = max((i + 1 for i in creeping.tolist() if i < most), default=0)
    end = count if goes_on else min((i for i in creeping.tolist() if i >= max(count - most, begin)), default=count)
    last = len(still) if end == count else end * size
    return still.part(slice(begin * size, last))


def wander(gyro: Floats, step: Floats) -> Floats:
    """Standard deviation (3,), rad/s, of the mean of a rest from bias wander beyond white noise; 0 in most rests.

    gyro (n, 3): readings of the rest, rad/s. step (3,): their rounding step, rad/s.
    Method: the scatter of eight piece means about a straight line. A bias that drifts linearly while warming up does
    not count as wander. White noise is mistaken for wander once in 1e4 rests.
    """
    pieces = gyro[: len(gyro) // 8 * 8].reshape(8, -1, 3)
    n = pieces.shape[1]
    if n < 2:
        return np.zeros(3)
    line = np.column_stack([np.ones(8), np.arange(8.0)])
    means = pieces.mean(axis=1)
    of_means = np.sum((means - line @ np.linalg.lstsq(line, means, rcond=None)[0]) ** 2, axis=0) / 6
    white = np.maximum(pieces.var(axis=1, ddof=1).mean(axis=0), step**2 / 12) / n
    return np.where(of_means > _WHITE * white, np.sqrt(of_means / 8), 0.0)
