"""The temperatures of a device, without their noise: those that leap are believed only when they stay.

A filter that takes noise for warmth learns from it, surer by every second, that warmth moves nothing.
"""

from collections import deque
from dataclasses import dataclass
from math import expm1, isfinite

#: temperatures kept, for bringing a rest's bias from then to now
_KEPT = 1000


@dataclass(frozen=True, slots=True)
class ThermometerKnobs:
    """A temperature that leaps by so many kelvin must stay for so long, s; over a longer silence it may go so much farther."""

    leap_k: float = 2.0
    leap_s: float = 10.0
    #: readings are averaged over about so long, s, which low-cost parts need (0.05 K) and in which warmth moves little
    average_s: float = 10.0
    #: what was read longer ago tells nothing of now, s
    stale_s: float = 60.0


class Thermometer:
    """Readings in; what they say of now, and of a while ago, out. °C, device s; NaN when unknown."""

    def __init__(self, knobs: ThermometerKnobs | None = None) -> None:
        self.knobs = knobs or ThermometerKnobs()
        self._read: deque[tuple[float, float]] = deque(maxlen=_KEPT)
        self._leapt: float | None = None  # since when they are beyond a leap
        #: the latest that is believed, noise and all
        self.reading = float("nan")

    @property
    def now(self) -> float:
        """The average."""
        return self._read[-1][1] if self._read else float("nan")

    @property
    def lag(self) -> float:
        """By how many kelvin the latest reading is above the average; 0 where there is none."""
        return self.reading - self.now if self._read else 0.0

    def read(self, time: float, celsius: float) -> None:
        """Note a reading; one that says nothing is none."""
        if not isfinite(celsius):
            return
        if self._read and abs(celsius - self.now) > self._believable(time):
            self._leapt = time if self._leapt is None else self._leapt
            if time - self._leapt < self.knobs.leap_s:
                return
        self.reading = celsius
        average = self.ahead(time, celsius) if self._leapt is None else celsius
        self._leapt = None
        self._read.append((time, average))

    def ahead(self, time: float, celsius: float) -> float:
        """The average that a reading will make; the present one where it is not to be believed yet."""
        if not self._read:
            return celsius
        if not abs(celsius - self.now) <= self._believable(time):
            return self.now
        share = -expm1(min(0.0, self._read[-1][0] - time) / self.knobs.average_s)
        return self.now + share * (celsius - self.now)

    def _believable(self, time: float) -> float:
        """How many kelvin it may be from the average: what was silent for minutes has cooled or warmed meanwhile."""
        return self.knobs.leap_k * max(1.0, (time - self._read[-1][0]) / self.knobs.leap_s)

    def go_on(self, time: float, celsius: float) -> None:
        """From an average that was kept; what was read since then is forgotten."""
        if isfinite(celsius):
            self._read.clear()
            self._read.append((time, celsius))

    def go_on_with(self, time: float, celsius: float, lag: float) -> None:
        """Note a reading; where it is the first, of a device whose average is `lag` K behind it."""
        first = not self._read
        self.read(time, celsius)
        if first:
            self.go_on(time, celsius - lag)

    def at(self, time: float) -> float:
        """As it was at a time; NaN where it has not been told for long."""
        if self._read and time - self._read[-1][0] > self.knobs.stale_s:
            return float("nan")
        later, warmer = float("inf"), float("nan")
        for then, celsius in reversed(self._read):  # it is asked for what was a moment ago
            if then <= time:
                share = (time - then) / (later - then)
                return celsius + share * (warmer - celsius) if share else celsius
            later, warmer = then, celsius
        return warmer
