"""What was refused, lost or given up on the whole ward: told as totals when they have changed, seldom enough to be read."""

import logging
from collections.abc import Callable

log = logging.getLogger(__name__)

EVERY_S = 10.0


class Totals:
    """Tells the counts that `read` gives; times are monotonic seconds."""

    def __init__(self, read: Callable[[], dict[str, int]]) -> None:
        self._read = read
        self._told: dict[str, int] = {}
        self._next_s = float("-inf")

    def tell(self, now: float, *, last: bool = False) -> None:
        """Log them if they changed since they were told."""
        counts = self._read()
        if counts == self._told or (now < self._next_s and not last):
            return
        self._told, self._next_s = counts, now + EVERY_S
        log.warning("so far: %s", ", ".join(f"{label} {n}" for label, n in sorted(counts.items())))
