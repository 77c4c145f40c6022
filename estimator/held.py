"""Samples that wait to be judged, kept as they come in: put in once, read and mended where they lie."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: samples at least that there is room for
_ROOM = 256


class Held:
    """Time, readings and flags in order; those that wait no longer are never written to again."""

    def __init__(self) -> None:
        self._begin = self._end = 0
        self._room(_ROOM)

    def __len__(self) -> int:
        return self._end - self._begin

    def put(self, time: Floats, gyro: Floats, accel: Floats | None, clipped: Flags | None) -> None:
        """Take samples (n,), (n, 3), (n, 3), (n,); an accelerometer that is not there reads NaN."""
        if self._end + len(time) > len(self._time):
            self._room(max(_ROOM, 2 * (len(self) + len(time))))
        put = slice(self._end, self._end + len(time))
        self._time[put], self._read[put, :3] = time, gyro
        self._read[put, 3:] = np.nan if accel is None else accel
        self._clipped[put] = False if clipped is None else clipped
        self._end = put.stop

    @property
    def span(self) -> float:
        """Seconds from the first to the last."""
        return float(self._time[self._end - 1] - self._time[self._begin]) if self._end > self._begin else 0.0

    @property
    def waiting(self) -> tuple[Floats, Floats, Flags]:
        """All that wait: time (n,), gyro and accel side by side (n, 6), clipped (n,)."""
        here = slice(self._begin, self._end)
        return self._time[here], self._read[here], self._clipped[here]

    def drop(self, n: int) -> None:
        """The first n wait no longer."""
        self._begin += n

    def _room(self, size: int) -> None:
        time, read, clipped = np.empty(size), np.empty((size, 6)), np.empty(size, bool)
        if n := len(self):
            time[:n], read[:n], clipped[:n] = self.waiting
        self._time, self._read, self._clipped = time, read, clipped
        self._begin, self._end = 0, n
