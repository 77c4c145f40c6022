"""The one rule for whether two output data rates are the same, for stores and files alike."""

#: relative. A rate is declared, or estimated anew in every boot: oscillators err by up to 1 %, and a median of steps by
#: less; no device has two rates so close. The scale of another boot is doubted by as much (gyro.PriorKnobs).
SAME_RATE = 0.02


def same_rate(one_hz: float, other_hz: float) -> bool:
    """Whether two rates are one; a rate that is not known, 0, is like no known one."""
    low_hz, high_hz = sorted((one_hz, other_hz))
    return high_hz - low_hz <= SAME_RATE * low_hz
