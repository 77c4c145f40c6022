"""Temperature filter of a device: averages the readings over 10 s, and accepts sudden changes only when they persist.

Without the average, thermometer noise would count as temperature change. The bias filter would then conclude, with
false certainty, that temperature does not change the bias.
"""

from math import expm1, isfinite

import msgspec

from estimator.state import StateStruct

#: number of averages kept, to relate an earlier rest's bias to the present, and their distance, s
_KEPT, _APART_S = 100, 1.0

#: a leap of so many kelvin must last so many seconds; after a longer silence the limit grows in proportion
_LEAP_K, _LEAP_S = 2.0, 10.0
#: s, averaging time: low-cost thermometers need it (0.05 K noise), and temperature changes little within it
AVERAGE_S = 10.0
#: s; older readings say nothing of the present
_STALE_S = 60.0


class Thermometer(StateStruct):
    """Temperature filter: averages the readings over 10 s.

    averages: recent averages as pairs of device time (s) and temperature (°C).
    leapt: device time since which the readings are too far from the average, s, or None.
    reading: latest accepted reading, unfiltered, °C; NaN before the first.
    """

    averages: list[tuple[float, float]] = msgspec.field(default_factory=list)
    leapt: float | None = None
    reading: float = float("nan")

    @property
    def now(self) -> float:
        """Present average temperature, °C; NaN before the first reading."""
        return self.averages[-1][1] if self.averages else float("nan")

    @property
    def lag(self) -> float:
        """Latest reading minus the average, K; 0 without readings."""
        return self.reading - self.now if self.averages else 0.0

    def read(self, time: float, celsius: float) -> None:
        """Add a reading, °C, at a device time, s; a reading that is not finite is ignored.

        A change of more than 2 K from the average must last 10 s before readings are accepted again.
        """
        if not isfinite(celsius):
            return
        if self.averages and abs(celsius - self.now) > self._believable(time):
            self.leapt = time if self.leapt is None else self.leapt
            if time - self.leapt < _LEAP_S:
                return
        kept = self.averages
        self.reading = celsius
        average = self.ahead(time, celsius) if self.leapt is None else celsius
        self.leapt = None
        if len(kept) > 1 and kept[-1][0] - kept[-2][0] < _APART_S:
            kept.pop()
        kept.append((time, average))
        del kept[:-_KEPT]

    def ahead(self, time: float, celsius: float) -> float:
        """Predict the average, °C, after a reading `celsius` (°C) at device time `time` (s), without adding the reading.

        A reading too far from the present average leaves the average unchanged.
        """
        if not self.averages:
            return celsius
        if not abs(celsius - self.now) <= self._believable(time):
            return self.now
        share = -expm1(min(0.0, self.averages[-1][0] - time) / AVERAGE_S)
        return self.now + share * (celsius - self.now)

    def _believable(self, time: float) -> float:
        """Largest accepted distance from the average, K; it grows with silence, as the device cools or warms."""
        return _LEAP_K * max(1.0, (time - self.averages[-1][0]) / _LEAP_S)

    def go_on(self, time: float, celsius: float) -> None:
        """Restart from a stored average temperature, °C, at a device time, s; all other averages are discarded.

        A stored average that is not finite has no effect.
        """
        if isfinite(celsius):
            self.averages.clear()
            self.averages.append((time, celsius))

    def go_on_with(self, time: float, celsius: float, lag: float) -> None:
        """Add a temperature reading, °C, at a device time, s; a first reading starts the average at the reading minus `lag`.

        lag: latest reading minus the average, K, as saved earlier in `BiasState.lag_k`.
        """
        first = not self.averages
        self.read(time, celsius)
        if first:
            self.go_on(time, celsius - lag)

    def at(self, time: float) -> float:
        """Average temperature, °C, at a device time, s, by interpolation.

        Returns NaN without readings, or more than 60 s after the last one.
        """
        if self.averages and time - self.averages[-1][0] > _STALE_S:
            return float("nan")
        later, warmer = float("inf"), float("nan")
        for then, celsius in reversed(self.averages):  # most requests are for a moment ago
            if then <= time:
                share = (time - then) / (later - then)
                return celsius + share * (warmer - celsius) if share else celsius
            later, warmer = then, celsius
        return warmer
