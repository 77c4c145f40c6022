"""What was refused, lost or given up on the whole ward: told as totals when they have changed, seldom enough to be read."""

import logging

log = logging.getLogger(__name__)

EVERY_S = 10.0


class Totals:
    """Tells counts; times are monotonic seconds."""

    def __init__(self) -> None:
        self._told: dict[str, int] = {}
        self._next_s = float("-inf")

    def tell(self, now: float, counts: dict[str, int], *, last: bool = False) -> None:
        """Log them if they changed since they were told."""
        if counts == self._told or (now < self._next_s and not last):
            return
        self._told, self._next_s = counts, now + EVERY_S
        log.warning("so far: %s", ", ".join(f"{label} {n}" for label, n in sorted(counts.items())))
