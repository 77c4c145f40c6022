"""Samples that wait to be judged, kept as they come in: put in once, read and mended where they lie."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: behind the columns of a block: 1 where a reading was clipped
CLIPPED = 7
WIDTH = 8
#: samples at least that there is room for
_ROOM = 256


class Held:
    """Rows of samples in order; those that wait no longer are never written to again."""

    def __init__(self) -> None:
        self._begin = self._end = 0
        self._room(_ROOM)

    def __len__(self) -> int:
        return self._end - self._begin

    def put(self, parts: Sequence[Floats], clipped: NDArray[np.bool_] | None) -> None:
        """Take samples as the parts of a block have them, (n, 7) each, and which of all of them were clipped (n,)."""
        n = sum(map(len, parts))
        if self._end + n > len(self._rows):
            self._room(max(_ROOM, 2 * (len(self) + n)))
        begin, self._end = self._end, self._end + n
        room = self._rows[begin : self._end, :CLIPPED]
        if len(parts) == 1:
            room[:] = parts[0]
        else:
            np.concatenate(parts, out=room)
        if clipped is not None:
            self._rows[begin : self._end, CLIPPED] = clipped

    @property
    def waiting(self) -> Floats:
        """(n, 8) all that wait."""
        return self._rows[self._begin : self._end]

    def drop(self, n: int) -> None:
        """The first n wait no longer."""
        self._begin += n

    def _room(self, size: int) -> None:
        rows, n = np.zeros((size, WIDTH)), len(self)  # nothing is clipped
        if n:
            rows[:n] = self.waiting
        self._rows, self._begin, self._end = rows, 0, n
