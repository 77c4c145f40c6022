"""Samples that wait to be judged, kept as they come in: put in once, read where they lie."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: samples at least that there is room for
_ROOM = 256


class Held:
    """Time, readings and flags in order; what has been handed out is never written to again."""

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
    def time(self) -> Floats:
        """(n,) of those that wait."""
        return self._time[self._begin : self._end]

    @property
    def span(self) -> float:
        """Seconds from the first to the last."""
        return float(self._time[self._end - 1] - self._time[self._begin])

    def leap(self, i: int) -> float:
        """Rad/s, by how much a reading of the gyro differs from the one before it."""
        (a, b, c), (x, y, z) = self._read[self._begin + i - 1 : self._begin + i + 1, :3].tolist()
        return float(max(abs(x - a), abs(y - b), abs(z - c)))

    def draw(self, n: int) -> tuple[Floats, Floats, Flags]:
        """The first n: time (n,), gyro and accel side by side (n, 6), clipped (n,)."""
        drawn = slice(self._begin, self._begin + n)
        self._begin = drawn.stop
        return self._time[drawn], self._read[drawn], self._clipped[drawn]

    def _room(self, size: int) -> None:
        time, read, clipped = np.empty(size), np.empty((size, 6)), np.empty(size, bool)
        if n := len(self):
            time[:n], read[:n], clipped[:n] = self.draw(n)
        self._time, self._read, self._clipped = time, read, clipped
        self._begin, self._end = 0, n
