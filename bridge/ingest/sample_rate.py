"""Measures a device's sample rate, and compares it with the nominal one."""

_WINDOW_S = 10.0
_DIFFERS, _AGREES = 0.02, 0.01  # of the nominal rate


class SampleRateMeter:
    """Measures the sample rate of one boot, and compares it with the nominal rate.

    hz: samples per host second over about the last ten seconds, missing samples included; 0 until known.
    differs: whether hz is more than 2 % off the nominal rate.
    """

    def __init__(self) -> None:
        self.hz = 0.0
        self.differs = False
        self._since: tuple[int, float] | None = None  # sequence and device time at the start of the window

    def observe(self, sequence: int, device_s: float, clock_rate: float, nominal_hz: float) -> bool:
        """Add a sample by its number and device time; return whether the rate begins to differ from the nominal one.

        clock_rate: host seconds per device second. nominal_hz: 0 if unknown.
        """
        if self._since is None:
            self._since = (sequence, device_s)
        since, since_s = self._since
        if device_s - since_s < 1.0:
            return False
        self.hz = (sequence - since) / ((device_s - since_s) * clock_rate)
        if device_s - since_s >= _WINDOW_S:
            self._since = (sequence, device_s)
        before, off = self.differs, abs(self.hz / nominal_hz - 1) if nominal_hz else 0.0
        self.differs = off > (_AGREES if before else _DIFFERS)
        return self.differs and not before
