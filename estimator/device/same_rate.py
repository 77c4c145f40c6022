"""Tolerance within which two output data rates count as equal, for stores and files alike."""

#: relative. Rates are declared, or estimated anew in every boot: oscillators err by up to 1 %, a median of steps by less.
#: No device has two rates so close. The scale of another boot is doubted by as much (gyro_model.PriorKnobs).
SAME_RATE = 0.02


def same_rate(one_hz: float, other_hz: float) -> bool:
    """Return whether two output data rates in Hz differ by at most 2 % (SAME_RATE) of the lower rate.

    A rate of 0 means unknown and equals no known rate.
    """
    low_hz, high_hz = sorted((one_hz, other_hz))
    return high_hz - low_hz <= SAME_RATE * low_hz
