"""Detects if a device sends timestamps: some devices can be configured either way, and a frame with the time may be lost."""

_SURE, _CHANGED = 2, 32  # consecutive samples: to decide first, to change the decision


class TimePresence:
    """Decides if a device's samples carry a timestamp.

    tells: the decision, True if samples carry a timestamp; None until decided.
    in_a_row: number of latest consecutive samples that agree with each other.
    """

    def __init__(self) -> None:
        self.tells: bool | None = None
        self.in_a_row = 0
        self._leaning = False

    def fits(self, *, timed: bool) -> bool:
        """Add a sample; return True if it agrees with the decision, False if not or while undecided.

        timed: True if the sample carries a timestamp.
        """
        self.in_a_row = self.in_a_row + 1 if timed == self._leaning else 1
        self._leaning = timed
        return timed == self.tells

    def settle(self) -> bool:
        """Decide, if enough of the latest samples agree; return True if a decision was made.

        The first decision needs 2 consecutive samples; a change of the decision needs 32.
        """
        if self.in_a_row < (_SURE if self.tells is None else _CHANGED):
            return False
        self.tells = self._leaning
        return True
