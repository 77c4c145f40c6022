"""Filtered temperature of a device: averaged, and leaps accepted only when they persist.

From noise taken for warmth the bias filter would learn, surer every second, that temperature does not move the bias.
"""

from dataclasses import dataclass
from math import expm1, isfinite

import msgspec

from estimator.state import StateStruct

#: number of averages kept, to relate an earlier rest's bias to the present, and their distance, s
_KEPT, _APART_S = 100, 1.0


@dataclass(frozen=True, slots=True)
class ThermometerKnobs:
    """Limits of the filter. A leap of leap_k kelvin must last leap_s; after a longer silence the limit grows in proportion."""

    leap_k: float = 2.0
    leap_s: float = 10.0
    #: s, averaging time: low-cost thermometers need it (0.05 K noise), and temperature changes little within it
    average_s: float = 10.0
    #: s; older readings say nothing of the present
    stale_s: float = 60.0


class ThermometerState(StateStruct):
    """State of the thermometer.

    averages: recent ones as (device time s, °C). leapt: device time, s, since which readings exceed a leap, or None.
    reading: latest accepted, unfiltered, °C.
    """

    averages: list[tuple[float, float]] = msgspec.field(default_factory=list)
    leapt: float | None = None
    reading: float = float("nan")


class Thermometer:
    """Temperature filter: readings in; present and recent averages out. °C, device s; NaN when unknown."""

    def __init__(self, knobs: ThermometerKnobs | None = None) -> None:
        self.knobs = knobs or ThermometerKnobs()
        self.state = ThermometerState()

    @property
    def reading(self) -> float:
        """Latest accepted reading, unfiltered, °C; NaN before the first."""
        return self.state.reading

    @property
    def now(self) -> float:
        """Present average temperature, °C; NaN before the first reading."""
        return self.state.averages[-1][1] if self.state.averages else float("nan")

    @property
    def lag(self) -> float:
        """Latest reading minus the average, K; 0 without readings."""
        return self.reading - self.now if self.state.averages else 0.0

    def read(self, time: float, celsius: float) -> None:
        """Add a reading at a device time, s; a reading that is not finite is ignored."""
        if not isfinite(celsius):
            return
        if self.state.averages and abs(celsius - self.now) > self._believable(time):
            self.state.leapt = time if self.state.leapt is None else self.state.leapt
            if time - self.state.leapt < self.knobs.leap_s:
                return
        state, kept = self.state, self.state.averages
        state.reading = celsius
        average = self.ahead(time, celsius) if state.leapt is None else celsius
        state.leapt = None
        if len(kept) > 1 and kept[-1][0] - kept[-2][0] < _APART_S:
            kept.pop()
        kept.append((time, average))
        del kept[:-_KEPT]

    def ahead(self, time: float, celsius: float) -> float:
        """Average, °C, that a reading `celsius` at device time `time`, s, would give, without adding the reading.

        The present average when the reading leaps too far.
        """
        if not self.state.averages:
            return celsius
        if not abs(celsius - self.now) <= self._believable(time):
            return self.now
        share = -expm1(min(0.0, self.state.averages[-1][0] - time) / self.knobs.average_s)
        return self.now + share * (celsius - self.now)

    def _believable(self, time: float) -> float:
        """Largest accepted distance from the average, K; it grows with silence, as the device cools or warms."""
        return self.knobs.leap_k * max(1.0, (time - self.state.averages[-1][0]) / self.knobs.leap_s)

    def go_on(self, time: float, celsius: float) -> None:
        """Restart the average from a stored one, °C, at a device time, s; all other averages are discarded.

        Nothing happens when it is not finite.
        """
        if isfinite(celsius):
            self.state.averages.clear()
            self.state.averages.append((time, celsius))

    def go_on_with(self, time: float, celsius: float, lag: float) -> None:
        """Add a reading, °C, at a device time, s; if it is the first, the average begins `lag` K below it."""
        first = not self.state.averages
        self.read(time, celsius)
        if first:
            self.go_on(time, celsius - lag)

    def at(self, time: float) -> float:
        """Average temperature, °C, at a device time, s, by interpolation.

        NaN without readings or long after the last one.
        """
        if self.state.averages and time - self.state.averages[-1][0] > self.knobs.stale_s:
            return float("nan")
        later, warmer = float("inf"), float("nan")
        for then, celsius in reversed(self.state.averages):  # most requests are for a moment ago
            if then <= time:
                share = (time - then) / (later - then)
                return celsius + share * (warmer - celsius) if share else celsius
            later, warmer = then, celsius
        return warmer
