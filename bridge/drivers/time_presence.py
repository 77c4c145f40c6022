"""Detects whether a device sends timestamps: some devices can be set either way, and a frame with the time may be lost."""

_SURE, _CHANGED = 2, 32  # consecutive samples: to decide first, to change the decision


class TimePresence:
    """Decides whether a device's samples carry a time.

    tells: True if samples carry a time; None until enough samples agree. in_a_row: number of the latest consecutive
    samples that agree with each other.
    """

    def __init__(self) -> None:
        self.tells: bool | None = None
        self.in_a_row = 0
        self._leaning = False

    def fits(self, *, timed: bool) -> bool:
        """Add the next sample; return whether it agrees with the decision. timed: whether it carries a time."""
        self.in_a_row = self.in_a_row + 1 if timed == self._leaning else 1
        self._leaning = timed
        return timed == self.tells

    def settle(self) -> bool:
        """Decide whether samples carry a time, if enough of the latest agree: 2 at first, 32 to change the decision.

        Return whether a decision was made.
        """
        if self.in_a_row < (_SURE if self.tells is None else _CHANGED):
            return False
        self.tells = self._leaning
        return True
