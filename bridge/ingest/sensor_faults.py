"""Detects readings of a faulty sensor: clipped at full scale, stuck at one value, or with a temperature step.

A sensor is stuck if the readings of all three axes repeat k times in a row. k is computed from the device's noise and
quantisation step, measured at rest. A healthy sensor then causes fewer than 1e-5 false alarms in a hundred device years.
A sensor whose noise is small compared with its quantisation step repeats readings by chance. Such a sensor is never
reported as stuck.
"""

from math import ceil, inf, log, pi, radians, sqrt
from operator import eq

import numpy as np
from numpy.typing import NDArray

from bridge.ingest.plausibility import within
from bridge.wire.messages import SampleFlag
from bridge.wire.refusal import Tally

CLIPPED_AT = 0.99  # of full scale
_NEARLY = 0.999  # of the clipping threshold: below this, rounding cannot hide a clipped reading
_LEAST_REPEATS = 5
_BUDGET = 1e-5 / (100 * 365.25 * 86_400)  # false alarms per device second
_RESTS = 10  # seconds at rest before the noise is known
_REST_STD = radians(1.0)
_LEAST_SAMPLES = 8  # samples of a usable second
_MOST_SAMPLES = 1 << 18  # samples of a second of a clock that hardly moves
_NOISY = 1.5  # steps: if the rms difference of two readings is below this, the quantisation step hides the noise
_LEAP_K, _WARMING_K_PER_S = 2.0, 1.0  # coarse thermometers step by a whole kelvin

Bools = NDArray[np.bool_]
Floats = NDArray[np.floating]
Flags = NDArray[np.uint32]


class SensorFaults:
    """Flags readings of a faulty sensor within one boot. The flags do not depend on how readings are split into batches.

    events: number of flagged samples, by label.
    """

    def __init__(self, events: Tally) -> None:
        self._events = events
        self._stuck = Repeats()
        self._warmth = Warmth()

    def flags(
        self,
        time_s: Floats,
        gyro: Floats,
        temperature_c: Floats | None,
        gyro_range: float,
        clipped: Bools | None = None,
    ) -> Flags:
        """Return the SampleFlag bits (n,) uint32 of n ≥ 1 good readings: clipped, stuck, temperature step.

        time_s (n,): device time, s. gyro (n, 3): rad/s, sensor frame. temperature_c (n,): °C, or None. gyro_range:
        full-scale range in rad/s, 0 if unknown. clipped (n,): True for samples that the device itself reports as
        clipped.
        A sample counts as clipped if an axis reaches 99 % of the full-scale range.
        """
        flags = np.zeros(len(gyro), np.uint32)
        if gyro_range and not within(gyro, _NEARLY * CLIPPED_AT * gyro_range):
            beyond = np.asarray((np.abs(gyro) >= CLIPPED_AT * gyro_range).any(axis=1))
            clipped = beyond if clipped is None else beyond | clipped
        if clipped is not None:
            self._mark(flags, SampleFlag.CLIPPED, clipped)
        self._mark(flags, SampleFlag.STUCK, self._stuck.seen(time_s, gyro))
        if temperature_c is not None:
            self._mark(flags, SampleFlag.TEMPERATURE_STEP, self._warmth.leapt(time_s, temperature_c))
        return flags

    def _mark(self, flags: Flags, flag: SampleFlag, which: Bools) -> None:
        if which.any():
            flags[which] |= np.uint32(flag)
            self._events.add((flag.name or "").lower(), int(np.count_nonzero(which)))


class Repeats:
    """Finds stuck readings: those that repeat the previous reading on all axes more often in a row than chance explains."""

    def __init__(self) -> None:
        self._last = np.full((1, 3), np.nan)
        self._run = 0  # consecutive repeats up to the last reading
        self._began = inf  # start of the current second
        self._second: list[Floats] = []
        self._gathered = 0  # samples in the current second
        self._stuck = False  # any sample of the current second
        self._noise = SelfRepetition()
        self._needed: float | None = inf  # None: compute when needed
        self._rate_hz = 0.0

    @property
    def needed(self) -> float:
        """Threshold for a stuck sensor: number of consecutive repeats. Infinite until the sensor's noise is known."""
        if self._needed is None:
            self._needed = self._noise.repeats(self._rate_hz)
        return self._needed

    def seen(self, time_s: Floats, gyro: Floats) -> Bools:
        """Return a mask (n,), True for stuck readings, of n readings that follow those of the previous call.

        gyro (n, 3): rad/s. time_s (n,): device time, s. The sensor's noise is estimated from blocks of one second of
        device time. So the flags do not depend on how the readings are split into calls.
        """
        stuck = np.zeros(len(gyro), bool)
        begin = 0
        while begin < len(gyro):
            if not self._second:
                self._began = float(time_s[begin])
            whole = time_s[-1] < self._began + 1.0
            end = len(gyro) if whole else begin + int(np.searchsorted(time_s[begin:], self._began + 1.0))
            end = min(end, begin + _MOST_SAMPLES - self._gathered)
            if end > begin:
                part = gyro[begin:end]
                if self._repeats(part):
                    stuck[begin:end] = self._too_many(part)
                    self._stuck |= bool(stuck[begin:end].any())
                self._last = part[-1:]
                self._second.append(part)
                self._gathered += len(part)
            if end < len(gyro):
                self._close()
            begin = end
        return stuck

    def _repeats(self, gyro: Floats) -> bool:
        """Return whether any of the next readings repeats the reading before it."""
        rows = gyro.tolist()
        if any(map(eq, rows, [*self._last.tolist(), *rows])):
            return True
        self._run = 0
        return False

    def _too_many(self, gyro: Floats) -> Bools:
        """Mask (n,) of the next readings that follow too many repeats."""
        same = (gyro == np.concatenate([self._last, gyro[:-1]])).all(axis=1)
        at = np.arange(len(same))
        runs = at - np.maximum.accumulate(np.where(same, -1 - self._run, at))
        self._run = int(runs[-1])
        return np.asarray(runs >= self.needed)

    def _close(self) -> None:
        second = np.concatenate(self._second)
        if not self._stuck and len(second) >= _LEAST_SAMPLES and (second.std(axis=0) < _REST_STD).all():
            self._noise.learn(second)
            self._needed, self._rate_hz = None, len(second)
        self._second, self._gathered, self._stuck = [], 0, False


class SelfRepetition:
    """Estimates the probability that a healthy sensor at rest repeats a reading; derives the threshold for a stuck sensor.

    A repeat is a reading that equals the reading before it. The threshold is a number of consecutive repeats.
    """

    def __init__(self) -> None:
        # Rms difference of two readings, in quantisation steps: of the quietest second; lowest median of ten seconds.
        self._least = self._quiet = np.full(3, inf)
        self._ten: list[Floats] = []
        self._pairs, self._equal, self._tried, self._again = (np.zeros(3) for _ in range(4))

    def learn(self, gyro: Floats) -> None:
        """Update the noise and the counts of repeats of each axis from readings at rest.

        gyro (n, 3): readings of one second, rad/s.
        """
        change = np.abs(np.diff(gyro, axis=0))
        step = np.where(change > 0, change, inf).min(axis=0)
        self._ten.append(np.sqrt(np.mean(change**2, axis=0)) / step)
        self._least = np.minimum(self._least, self._ten[-1])
        if len(self._ten) == _RESTS:
            self._quiet = np.minimum(self._quiet, np.median(self._ten, axis=0))
            self._ten = []
        equal = change == 0
        self._pairs += len(equal)
        self._equal += equal.sum(axis=0)
        self._tried += equal[:-1].sum(axis=0)
        self._again += (equal[:-1] & equal[1:]).sum(axis=0)

    def repeats(self, rate_hz: float) -> float:
        """Return the threshold for a stuck sensor: the least number of consecutive repeats that chance does not explain.

        A repeat counts only if all three axes repeat. The threshold is at least 5. rate_hz: sample rate, Hz.
        Infinite if a healthy sensor may repeat itself any number of times, or until ten seconds at rest have been learnt.
        With this threshold, a healthy sensor causes fewer than 1e-5 false alarms in a hundred device years.
        Method: the probability of a repeat on one axis is 1 / (√(2π) σ). σ is the rms difference of two successive
        readings at rest, in quantisation steps; the difference is assumed Gaussian. A second estimate is the counted
        ratio of repeats, less two standard deviations. The larger estimate is used, because filtered noise, and sensors
        that are read more often than they measure, repeat more often than white noise. The first repeat in a row
        and each further one have probabilities of their own. An axis with σ below 1.5 counts as always repeating. The
        probabilities of the three axes are multiplied.
        """
        if not np.isfinite(self._quiet).all():
            return inf
        hidden = self._least < _NOISY
        gaussian = 1 / (sqrt(2 * pi) * np.where(hidden, 1.0, self._quiet))
        first = np.where(hidden, 1.0, np.maximum(gaussian, _at_least(self._equal, self._pairs)))
        then = np.where(hidden, 1.0, np.maximum(gaussian, _at_least(self._again, self._tried)))
        p_first, p_then = float(first.prod()), float(then.prod())
        if p_then >= 1:
            return inf
        return max(_LEAST_REPEATS, 1 + ceil(log(_BUDGET / rate_hz / p_first) / log(p_then)))


def _at_least(happened: Floats, tried: Floats) -> Floats:
    """Probabilities from counts, less two standard deviations."""
    p = (happened + 1) / (tried + 2)
    return np.asarray(p - 2 * np.sqrt(p * (1 - p) / (tried + 2)))


class Warmth:
    """Finds implausible temperature steps: more than 2 K, plus 1 K per second since the last accepted temperature."""

    def __init__(self) -> None:
        self._believed: tuple[float, float] | None = None  # time s, °C

    def leapt(self, time_s: Floats, temperature_c: Floats) -> Bools:
        """Return a mask (n,), True for implausible temperatures. temperature_c (n,): °C. time_s (n,): device time, s.

        A temperature is implausible if it differs from the last accepted one by more than 2 K + t · 1 K/s. t is the
        time in s since the last accepted one. So a lasting change is accepted after some time.
        """
        at_s, believed_c = self._believed or (float(time_s[0]), float(temperature_c[0]))
        leaps = np.zeros(len(temperature_c), bool)
        # Almost always all pass, and the loop is not needed.
        if (np.abs(temperature_c - believed_c) <= _LEAP_K).all():
            self._believed = float(time_s[-1]), float(temperature_c[-1])
            return leaps
        for i, (now_s, now_c) in enumerate(zip(time_s.tolist(), temperature_c.tolist(), strict=True)):
            leaps[i] = abs(now_c - believed_c) > _LEAP_K + _WARMING_K_PER_S * (now_s - at_s)
            if not leaps[i]:
                at_s, believed_c = now_s, now_c
        self._believed = at_s, believed_c
        return leaps
