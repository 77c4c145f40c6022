"""Whether a device sends its time: some can be set either way, and a frame with it may be lost."""

_SURE, _CHANGED = 2, 32  # samples in a row


class TimePresence:
    """tells: whether it does, None until it is clear. in_a_row: samples of late that agree with each other."""

    def __init__(self) -> None:
        self.tells: bool | None = None
        self.in_a_row = 0
        self._leaning = False

    def fits(self, *, timed: bool) -> bool:
        """Take the next sample's: whether it is as was settled."""
        self.in_a_row = self.in_a_row + 1 if timed == self._leaning else 1
        self._leaning = timed
        return timed == self.tells

    def settle(self) -> bool:
        """Believe the latest samples, if they are enough to."""
        if self.in_a_row < (_SURE if self.tells is None else _CHANGED):
            return False
        self.tells = self._leaning
        return True
