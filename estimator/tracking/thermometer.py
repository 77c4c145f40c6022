"""The temperatures of a device, without their noise: those that leap are believed only when they stay.

A filter that takes noise for warmth learns from it, surer by every second, that warmth moves nothing.
"""

from dataclasses import dataclass
from math import expm1, isfinite

import msgspec

from estimator.state import StateStruct

#: averages kept, for bringing a rest's bias from then to now, and how far they are apart, s
_KEPT, _APART_S = 100, 1.0


@dataclass(frozen=True, slots=True)
class ThermometerKnobs:
    """A temperature that leaps by so many kelvin must stay for so long, s; over a longer silence it may go so much farther."""

    leap_k: float = 2.0
    leap_s: float = 10.0
    #: readings are averaged over about so long, s, which low-cost parts need (0.05 K) and in which warmth moves little
    average_s: float = 10.0
    #: what was read longer ago tells nothing of now, s
    stale_s: float = 60.0


class ThermometerState(StateStruct):
    """Averages by time; since when readings are beyond a leap; the latest that is believed, noise and all."""

    averages: list[tuple[float, float]] = msgspec.field(default_factory=list)
    leapt: float | None = None
    reading: float = float("nan")


class Thermometer:
    """Readings in; what they say of now, and of a while ago, out. °C, device s; NaN when unknown."""

    def __init__(self, knobs: ThermometerKnobs | None = None) -> None:
        self.knobs = knobs or ThermometerKnobs()
        self.state = ThermometerState()

    @property
    def reading(self) -> float:
        """The latest that is believed, noise and all."""
        return self.state.reading

    @property
    def now(self) -> float:
        """The average."""
        return self.state.averages[-1][1] if self.state.averages else float("nan")

    @property
    def lag(self) -> float:
        """By how many kelvin the latest reading is above the average; 0 where there is none."""
        return self.reading - self.now if self.state.averages else 0.0

    def read(self, time: float, celsius: float) -> None:
        """Note a reading; one that says nothing is none."""
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
        """The average that a reading will make; the present one where it is not to be believed yet."""
        if not self.state.averages:
            return celsius
        if not abs(celsius - self.now) <= self._believable(time):
            return self.now
        share = -expm1(min(0.0, self.state.averages[-1][0] - time) / self.knobs.average_s)
        return self.now + share * (celsius - self.now)

    def _believable(self, time: float) -> float:
        """How many kelvin it may be from the average: what was silent for minutes has cooled or warmed meanwhile."""
        return self.knobs.leap_k * max(1.0, (time - self.state.averages[-1][0]) / self.knobs.leap_s)

    def go_on(self, time: float, celsius: float) -> None:
        """From an average that was kept; what was read since then is forgotten."""
        if isfinite(celsius):
            self.state.averages.clear()
            self.state.averages.append((time, celsius))

    def go_on_with(self, time: float, celsius: float, lag: float) -> None:
        """Note a reading; where it is the first, of a device whose average is `lag` K behind it."""
        first = not self.state.averages
        self.read(time, celsius)
        if first:
            self.go_on(time, celsius - lag)

    def at(self, time: float) -> float:
        """As it was at a time; NaN where it has not been told for long."""
        if self.state.averages and time - self.state.averages[-1][0] > self.knobs.stale_s:
            return float("nan")
        later, warmer = float("inf"), float("nan")
        for then, celsius in reversed(self.state.averages):  # it is asked for what was a moment ago
            if then <= time:
                share = (time - then) / (later - then)
                return celsius + share * (warmer - celsius) if share else celsius
            later, warmer = then, celsius
        return warmer
