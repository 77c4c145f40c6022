"""Reorder buffer: messages of one boot that came before their turn wait until what is missing before them comes, or is late.

Pure; `now` is seconds of a steady clock. Repeated samples pass through: `sequence` counts them.
"""

from bisect import insort
from typing import NamedTuple

from estimator.device.samples import Samples

#: how long a hole is waited for, and how many samples are held meanwhile
WAIT_S, WINDOW = 0.1, 1024


class _Held(NamedTuple):
    sequence: int
    order: int
    batch: Samples
    came_s: float


class ReorderBuffer:
    """`held` lies in the order of its numbers; truthy while anything is held. begins: the number to begin with, if known."""

    def __init__(self, begins: int | None = None) -> None:
        self._begins = begins or 0
        self.held: list[_Held] = []
        #: in all that is held
        self.samples = 0
        self._came = 0

    def __bool__(self) -> bool:
        return bool(self.held)

    def feed(self, batch: Samples, awaited: int | None, now: float) -> list[Samples]:
        """Those whose turn it is, when this one comes and number `awaited` is next; None: the boot's first is not known."""
        awaited = self._begins if awaited is None else awaited
        if batch.sequence <= awaited:
            return [batch, *self._in_turn(max(awaited, batch.sequence + batch.n))]
        self._came += 1
        insort(self.held, _Held(batch.sequence, self._came, batch, now))
        self.samples += batch.n
        return self._up_to(0) if self.samples > WINDOW else []

    def overdue(self, now: float) -> list[Samples]:
        """What has been held for WAIT_S, all before it, and what follows without a hole."""
        late = [n for n, held in enumerate(self.held) if now - held.came_s >= WAIT_S]
        return self._up_to(late[-1]) if late else []

    def drop(self) -> list[Samples]:
        """All that is held, whatever is missing before it."""
        return self._up_to(len(self.held) - 1) if self.held else []

    def _up_to(self, last: int) -> list[Samples]:
        """Wait no longer for what is missing before the held one with this place."""
        given = [held.batch for held in self.held[: last + 1]]
        del self.held[: last + 1]
        self.samples -= sum(batch.n for batch in given)
        return given + self._in_turn(max(batch.sequence + batch.n for batch in given))

    def _in_turn(self, awaited: int) -> list[Samples]:
        n = 0
        while n < len(self.held) and self.held[n].sequence <= awaited:
            awaited = max(awaited, self.held[n].sequence + self.held[n].batch.n)
            n += 1
        given = [held.batch for held in self.held[:n]]
        del self.held[:n]
        self.samples -= sum(batch.n for batch in given)
        return given
