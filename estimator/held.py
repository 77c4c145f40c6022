"""Samples that wait to be judged, kept as they come in: put in once, read and mended where they lie."""

import numpy as np
from numpy.typing import NDArray

from estimator.block import TIME

Floats = NDArray[np.float64]

#: behind the columns of a block: 1 where a reading was clipped
CLIPPED = 7
_WIDTH = 8
#: samples at least that there is room for
_ROOM = 256


class Held:
    """Rows of samples in order; those that wait no longer are never written to again."""

    def __init__(self) -> None:
        self._begin = self._end = 0
        self._room(_ROOM)

    def __len__(self) -> int:
        return self._end - self._begin

    def put(self, rows: Floats, clipped: NDArray[np.bool_] | None) -> None:
        """Take samples as a block has them (n, 7), and which of them were clipped (n,)."""
        end = self._end + len(rows)
        if end > len(self._rows):
            self._room(max(_ROOM, 2 * (len(self) + len(rows))))
            end = self._end + len(rows)
        put = self._rows[self._end : end]
        put[:, :CLIPPED] = rows
        put[:, CLIPPED] = 0.0 if clipped is None else clipped
        self._end = end

    @property
    def span(self) -> float:
        """Seconds from the first to the last."""
        return self._rows.item(self._end - 1, TIME) - self._rows.item(self._begin, TIME) if len(self) else 0.0

    @property
    def waiting(self) -> Floats:
        """(n, 8) all that wait."""
        return self._rows[self._begin : self._end]

    def drop(self, n: int) -> None:
        """The first n wait no longer."""
        self._begin += n

    def _room(self, size: int) -> None:
        rows, n = np.empty((size, _WIDTH)), len(self)
        if n:
            rows[:n] = self.waiting
        self._rows, self._begin, self._end = rows, 0, n
